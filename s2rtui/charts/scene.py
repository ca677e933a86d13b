"""The data that views draw: state and store of a session, and results of background loading."""

from __future__ import annotations

import math
from collections.abc import Mapping, Set
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.findings import FindingReport
from s2rstore.findings.groups import GroupErrors, Groups
from s2rstore.gap_history.reader import History
from s2rstore.intervals import Interval
from s2rstore.language import base_population, evaluation
from s2rstore.metrics.recall import Headline
from s2rstore.reader import Store
from s2rstore.records import SPLITS, Direction, Side
from s2rtui.analysis.identity_cache import ArrayKey, cached_by_identity
from s2rtui.canvas import BrushShape
from s2rtui.canvas.fit_text import fit_text
from s2rtui.charts.shared.instance import InstanceInput
from s2rtui.drawing.drawing import ColourBar
from s2rtui.drawing.image import Image
from s2rtui.session.error_groups import pivot_grouping
from s2rtui.session.provenance import (
    HeatProvenance,
    InstanceProvenance,
    groups_key,
    heat_provenance,
    instance_provenance,
    visible_floor_key,
)
from s2rtui.session.state import State
from s2rtui.user_data.notebook import Notes

_LONGEST = 32
"""Most cells of the name of a run in a title."""
FloorGrid = NDArray[np.float32]
_UNKNOWN = Headline(0, 0, math.nan, math.nan, math.nan, "")


@dataclass(frozen=True, slots=True)
class OverviewRow:
    """The mean accuracies of one run, 0 .. 1.

    `n` counts the instances behind the numbers. `note` is shown in the place of the numbers, and
    says why they have no interval. `headlines` are the median errors and the recall of both sides.
    """

    run: str
    sim: Interval
    real: Interval
    n: int = 0
    note: str = ""
    headlines: tuple[Headline, Headline] = (_UNKNOWN, _UNKNOWN)


@dataclass(frozen=True, slots=True)
class TranslatorGain:
    """Mean decrease of the real error in metres by a translator, with its 95 % interval.

    Of `run` with the translator in front of its network, or, where `trained`, of `run` that was
    trained on translated images, compared with the run that judged it.
    """

    run: str
    value: float
    interval: tuple[float, float] | None = None
    trained: bool = False

    @property
    def is_harm(self) -> bool:
        """Whether the error clearly increases."""
        return self.interval is not None and self.interval[1] < 0

    @property
    def short(self) -> str:
        """`gain +1.20 m (0.84 to 1.57)`; no number where the interval holds zero."""
        name = "training gain" if self.trained else "gain"
        if self.interval is None or self.interval[0] <= 0 <= self.interval[1]:
            return f"no clear {name}"
        low, high = self.interval
        return f"{name} {self.value:+.2f} m ({low:.2f} to {high:.2f})"

    @property
    def text(self) -> str:
        """`gain +1.20 m (0.84 to 1.57) on vanilla`."""
        return f"{self.short} {'of' if self.trained else 'on'} {self.run}"


@dataclass(frozen=True, slots=True)
class TranslatorRow:
    """A translator with its verdict, None where it was not judged, and its gains."""

    translator: str
    direction: Direction
    accepted: bool | None
    gains: tuple[TranslatorGain, ...] = ()

    @property
    def verdict(self) -> str:
        return {True: "accepted", False: "refused", None: "not judged"}[self.accepted]

    def gain_text(self, run: str) -> str:
        """The gain on a run, and the other runs that the translator harms; empty if unknown."""
        parts = [gain.short for gain in self.gains if gain.run == run]
        harmed = [
            gain.run for gain in self.gains if gain.is_harm and not gain.trained and gain.run != run
        ]
        return "; ".join([*parts, *([f"harms {', '.join(harmed)}"] if harmed else [])])


@dataclass(frozen=True, slots=True, eq=False)
class RunAccuracies:
    """Accuracies (N,) of every run on one side.

    `trained` (N,) marks the instances that the model of any run was trained on, where such are
    included; None where there are none.
    """

    side: Side
    values: Mapping[str, NDArray[np.float32]]
    trained: NDArray[np.bool_] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LoadedGroups:
    """Errors of groups of instances; `source` names what they were computed from."""

    source: tuple[object, ...]
    grouped: Groups
    rows: tuple[GroupErrors, ...]


def model_source(state: State) -> tuple[object, ...]:
    """Everything that the numbers of a statistical view depend on."""
    instances = state.trajectories, ArrayKey(state.base), ArrayKey(state.selected)
    return state.generation, state.run, state.with_trained, instances


@dataclass(frozen=True, slots=True, eq=False)
class LoadedModel:
    """The numbers of a statistical view; `source` names what they were computed from."""

    source: tuple[object, ...]
    model: Any

    def is_of(self, state: State) -> bool:
        """Whether the numbers belong to the run of a state; the selection may differ."""
        return self.source[:-1] == model_source(state)[:-1]


@dataclass(frozen=True, slots=True, eq=False)
class LoadedSheet:
    """Thumbnails by iid. `source` names what they show, `bar` is the scale of their heat."""

    source: tuple[object, ...]
    images: Mapping[int, Image]
    bar: ColourBar | None = None


@dataclass(frozen=True, slots=True, eq=False)
class LoadedData:
    """The results of background loading, each with its source where it may be out of date.

    `floor_heat` is the heat on the map and `seen_floor` the part of the floor that the selection
    has seen, (rows, cols) each; `live` is the instance that is being adjusted. `groups`, `cells`,
    `findings` and `sheet` belong to the views rooms, pivot, findings and sheet. `models` are the
    numbers of statistical views by name; None: they are computed when they are drawn. `progress` (0
    .. 1) and `failed` (messages) are by the name of the loader. `computation` is the progress of a
    command that the user has started here, `computing` that of another process which computes in
    the store.
    """

    rows: tuple[OverviewRow, ...] = ()
    translators: tuple[TranslatorRow, ...] = ()
    lines: RunAccuracies | None = None
    baseline: float = math.nan
    floor_plan: NDArray[np.uint8] | None = None
    pictures: InstanceInput | None = None
    pictures_source: InstanceProvenance | None = None
    floor_heat: FloorGrid | None = None
    floor_heat_source: HeatProvenance | None = None
    seen_floor: FloorGrid | None = None
    seen_floor_source: tuple[object, ...] | None = None
    live: InstanceInput | None = None
    live_source: InstanceProvenance | None = None
    live_floor_heat: FloorGrid | None = None
    history: History | None = None
    groups: LoadedGroups | None = None
    cells: LoadedGroups | None = None
    findings: FindingReport | None = None
    sheet: LoadedSheet | None = None
    models: Mapping[str, LoadedModel] | None = None
    progress: Mapping[str, float] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
    computation: str = ""
    computing: str = ""

    def accuracies(self, state: State) -> RunAccuracies | None:
        """The accuracies of every run; None if instances were added since they were loaded."""
        if self.lines is None:
            return None
        sizes = {column.size for column in self.lines.values.values()}
        return self.lines if sizes <= {state.selected.size} else None

    def heat_on_map(self, state: State) -> FloorGrid | None:
        """The heat that belongs on the map; while adjusting, that of the adjusted images."""
        if state.adjusting and state.overlay == "instance":
            return self.live_floor_heat if self.live_source == instance_provenance(state) else None
        source = self.floor_heat_source
        return self.floor_heat if source and source.name == heat_provenance(state).name else None

    def heat_note(self, state: State) -> str:
        """Names the source of the heat on the map where it is not the current one."""
        if state.adjusting and state.overlay == "instance":
            return ""
        return self.floor_heat_source.label(state) if self.floor_heat_source else ""

    def seen_on_map(self, state: State) -> FloorGrid | None:
        """The part of the floor that the current selection saw."""
        current = self.seen_floor_source == visible_floor_key(state)
        return self.seen_floor if state.dims_unseen_floor and current else None

    def adjusted(self, state: State) -> InstanceInput | None:
        """The adjusted instance, if it comes from the current run."""
        source = self.live_source
        return self.live if source and source.source == (state.generation, state.run) else None

    def current_groups(self, state: State) -> LoadedGroups | None:
        """The groups that a state shows; None until they are computed."""
        groups = self.groups
        return groups if groups and groups.source == groups_key(state, state.grouping) else None

    def current_cells(self, state: State) -> LoadedGroups | None:
        """The groups of the pivot of a state; None until they are computed."""
        cells = self.cells
        return cells if cells and cells.source == groups_key(state, pivot_grouping(state)) else None

    def with_requested(self, loaders: Set[str], cleared: Mapping[str, Any]) -> LoadedData:
        """A copy after new requests: no progress or failure of these loaders, fields cleared."""
        progress = {name: share for name, share in self.progress.items() if name not in loaders}
        failed = {name: error for name, error in self.failed.items() if name not in loaders}
        return replace(self, **cleared, progress=progress, failed=failed)

    def with_loaded(self, loader: str, fields: Mapping[str, Any], error: str) -> LoadedData:
        """A copy with the result of a loader, or with the reason why it failed."""
        if "models" in fields:
            fields = {**fields, "models": {**(self.models or {}), **fields["models"]}}
        loaded = self.with_requested({loader}, fields)
        return replace(loaded, failed={**loaded.failed, loader: error}) if error else loaded

    def with_progress(self, message: str) -> str:
        """A message followed by the progress of every loader and of the computing process."""
        shares = ", ".join(f"{loader} {share:.0%}" for loader, share in self.progress.items())
        computing = "" if self.computation else self.computing  # that has its own progress
        return "  ".join(part for part in (message, shares, computing) if part)


@cached_by_identity(8)
def _both(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The instances of both masks (N,)."""
    return first & second


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything that views draw from."""

    store: Store
    state: State
    loaded: LoadedData
    notes: Notes = field(default_factory=Notes)

    def remark(self, iid: int) -> str:
        """The user's tags and note on an instance."""
        remark = self.notes.remarks.get(iid)
        return remark.text if remark else ""

    @property
    def title(self) -> str:
        """What titles of figures begin with: the run, or the data set where there are no runs."""
        return fit_text(self.state.run or self.store.dataset.name, _LONGEST, "…")

    @property
    def caption(self) -> str:
        """The subtitle of a figure: data set, number of instances, expression."""
        counted = f"{self.state.count_text} instances"
        return "  ·  ".join((self.store.dataset.name, counted, self.state.expression))

    @property
    def trained_note(self) -> str:
        """`32 trained on included` where the views show trained instances; else empty."""
        marked = self.state.marked
        return "" if marked is None else f"{np.count_nonzero(marked)} trained on included"

    def common_base(self, other: str) -> NDArray[np.bool_]:
        """(N,) the instances of the base population that count in another run, too."""
        state = self.state
        context = evaluation.context(self.store, state.run, with_trained=state.with_trained)
        return _both(state.base, base_population(context, other))

    def common_marked(self, other: str) -> NDArray[np.bool_] | None:
        """(N,) the instances of `common_base` that the model of either run was trained on, for
        views to mark; None without any.
        """
        trained = self.store.run_columns(other).trained
        return _either(self.state.trained, trained, self.common_base(other))

    def other_trained_note(self, other: str) -> str:
        """`3 trained on by dataaug left out`: of the base population, by another run's model."""
        columns = self.store.run_columns(other)
        count = np.count_nonzero(self.state.base & columns.valid & columns.trained)
        if not count:
            return ""
        verb = "left out" if self.state.population.leaves_out_trained(columns) else "included"
        return f"{count} trained on by {other} {verb}"

    def splits(self, iids: NDArray[np.intp]) -> list[str | None]:
        """The split of each instance in the present run; None where unknown."""
        codes = self.store.run_columns(self.state.run).split[iids].tolist()
        return [SPLITS[code] if code >= 0 else None for code in codes]

    def mark(self, view: str) -> BrushShape | None:
        """The brush mark that is being drawn in a view."""
        brush = self.state.brush
        return brush.mark if brush is not None and brush.view == view else None


@cached_by_identity(2)
def _either(
    first: NDArray[np.bool_], second: NDArray[np.bool_], base: NDArray[np.bool_]
) -> NDArray[np.bool_] | None:
    """The instances of `base` (N,) in either mask; None without any."""
    marked = (first | second) & base
    return marked if marked.any() else None
