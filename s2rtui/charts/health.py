"""The health view: faults of images, poses and times that `s2r check` found, by their kind."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from s2rstore.image_faults import FAULTS
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.analysis.binning import Bools
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import StatisticsView, Table
from s2rtui.drawing.table import Cell, Column, Row, TableSpec
from s2rtui.session.state import State

NAMES = ("fault", "domain", "n", "share", "selected", "meaning", "expression")
_RANGES = 12
"""Ranges of instances that a row lists."""


@dataclass(frozen=True, slots=True)
class FaultCount:
    """How many images of a domain have a fault, their share of all, and which instances these are.

    instances: as `3, 7..12`, the first ranges of many.
    """

    domain: str
    n: int
    share: float
    instances: str


@dataclass(frozen=True, slots=True)
class FaultRow:
    """A fault in each domain that has it, and the selected instances that have it in any."""

    name: str
    counts: tuple[FaultCount, ...]
    selected: int


@dataclass(frozen=True, slots=True)
class FoundFaults:
    """The faults that occur, in the order of `FAULTS`, and the number of images by domain.

    unchecked: the images of these domains that were added after the check.
    """

    rows: tuple[FaultRow, ...]
    images: tuple[tuple[str, int], ...]
    unchecked: int = 0

    @classmethod
    def of(
        cls, faults: Mapping[str, Mapping[str, Bools]], images: Mapping[str, int],
        selected: Bools, unchecked: int = 0,
    ) -> FoundFaults:  # fmt: skip
        """Count faults: masks (N,) by domain and name."""
        rows = []
        for name in FAULTS:
            masks = {domain: found[name] for domain, found in faults.items() if name in found}
            counts = tuple(
                FaultCount(domain, int(mask.sum()), int(mask.sum()) / images[domain], ranges(mask))
                for domain, mask in masks.items()
            )
            if counts:
                either = np.logical_or.reduce(list(masks.values()))
                rows.append(FaultRow(name, counts, int(np.count_nonzero(either & selected))))
        return cls(tuple(rows), tuple(images.items()), unchecked)


def ranges(mask: Bools) -> str:
    """Instances as `3, 7..12`; the first ranges of many."""
    iids = np.flatnonzero(mask)
    runs = np.split(iids, np.flatnonzero(np.diff(iids) > 1) + 1)
    texts = [f"{run[0]}" if run.size == 1 else f"{run[0]}..{run[-1]}" for run in runs[:_RANGES]]
    more = len(runs) - len(texts)
    return f"{', '.join(texts)}{f' and {more} more' if more else ''}"


def health_table(model: FoundFaults, with_selected: bool = True) -> TableSpec:
    """A row per fault: images with it in each domain and their share, and selected ones.

    Notes of a row say what it means and list the instances.
    """
    columns = [Column("fault"), *(Column(domain, right=True) for domain, _ in model.images)]
    if with_selected:
        columns.append(Column("selected", right=True, rank=1))
    rows = []
    for row in model.rows:
        counts = {count.domain: count for count in row.counts}
        cells = [Cell(row.name)]
        for domain, _ in model.images:
            count = counts.get(domain)
            cells.append(Cell("0") if count is None else Cell(f"{count.n}", f"{count.share:.1%}"))
        if with_selected:
            cells.append(Cell(f"{row.selected}"))
        listed = (f"{count.domain}: {count.instances}" for count in row.counts)
        rows.append(Row(tuple(cells), notes=(FAULTS[row.name], *listed)))
    return TableSpec(tuple(columns), tuple(rows))


def health_notes(model: FoundFaults) -> tuple[str, ...]:
    """How many images were checked, and what was not."""
    counts = (f"{count} of {name}" for name, count in model.images)
    notes = [f"{'' if model.rows else 'no fault found; '}images: {', '.join(counts)}"]
    if model.unchecked:
        notes.append(f"{model.unchecked} images were added after the check; run it again")
    return tuple(notes)


def health_rows(model: FoundFaults) -> Iterator[tuple[object, ...]]:
    """Rows of the columns `NAMES`."""
    for row in model.rows:
        for count in row.counts:
            yield (row.name, count.domain, count.n, round(count.share, 6), row.selected,
                   FAULTS[row.name], f"health:{row.name}")  # fmt: skip


class HealthView(StatisticsView):
    name = "health"
    key = "("
    description = "health: faults of images, poses and times that s2r check found"
    about = "faults of images (enter: select)"
    title = "faults of images, poses and times"
    needs_poses = False
    needs_run = False
    figure_size = (1600, 1000)

    def model(self, store: Store, state: State) -> FoundFaults | str:
        if not store.checked_domains:
            return f"no image has been checked: `s2r check {store.path}` finds faults"
        checked = store.checked_domains
        faults = {domain: store.faults(domain) for domain in checked}
        now = sum(int(np.count_nonzero(store.imaged(domain))) for domain in checked)
        unchecked = max(0, now - sum(checked.values()))
        return FoundFaults.of(faults, checked, np.asarray(state.selected), unchecked)

    def table(self, model: FoundFaults) -> TableSpec:
        return health_table(model)

    def notes(self, model: FoundFaults) -> tuple[str, ...]:
        return health_notes(model)

    def choices(self, model: FoundFaults, side: Side) -> Sequence[tuple[str, str]]:
        return [(row.name, f"health:{row.name}") for row in model.rows]

    def numbers(self, scene: Scene) -> Table:
        model = self.input(scene)
        return NAMES, list(health_rows(model)) if isinstance(model, FoundFaults) else []


VIEW = HealthView()
