"""The numbers of the overview: accuracies of every run and the axis that shows them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from s2rstore.metrics import run_metrics
from s2rstore.metrics.recall import headline
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.charts.overview.bands import MOST_LINES
from s2rtui.charts.scene import OverviewRow
from s2rtui.drawing.scale import Floats, Interval, finite_or_none, tick_step


@dataclass(frozen=True, slots=True, eq=False)
class OverviewLines:
    """Each instance as a line across the runs.

    values: accuracies (N,) on `side` per run, in the order of the rows; NaN for none. selected,
    valid: (N,) bool. cursor: an iid whose line is drawn on top with its numbers. trained: (N,)
    marks instances that the model of a run was trained on, None where none is shown.
    """

    values: tuple[Floats, ...]
    selected: Bools
    valid: Bools
    side: Side = "real"
    cursor: int | None = None
    trained: Bools | None = None

    @property
    def counts(self) -> tuple[int, int]:
        """Numbers of valid instances: selected ones without the trained, and unselected ones."""
        valid, selected = (np.asarray(part, dtype=np.bool_) for part in (self.valid, self.selected))
        new = selected if self.trained is None else selected & ~np.asarray(self.trained)
        others = int(np.count_nonzero(valid)) - int(np.count_nonzero(valid & selected))
        return int(np.count_nonzero(valid & new)), others

    @property
    def banded(self) -> tuple[bool, bool]:
        """Whether these instances are so many that they become bands."""
        highlighted, others = self.counts
        return highlighted > MOST_LINES, others > MOST_LINES


@dataclass(frozen=True, slots=True)
class OverviewModel:
    """Rows with NaN turned into None, and the axis (accuracies) that holds them all."""

    rows: tuple[OverviewRow, ...]
    baseline: float | None
    axis: Interval


def overview_model(
    rows: Sequence[OverviewRow], baseline: float | None = None, lines: OverviewLines | None = None
) -> OverviewModel:
    """Clean the rows and find the axis, rounded outwards within 0 .. 1.

    With lines the axis includes the 1st percentile of the valid instances of every run, and 1.
    """
    if lines is None:
        return _model(tuple(rows), baseline, (), None)
    return _model(tuple(rows), baseline, lines.values, lines.valid)


@cached_by_identity(8)
def _model(
    rows: tuple[OverviewRow, ...],
    baseline: float | None,
    columns: tuple[Floats, ...],
    valid: Bools | None,
) -> OverviewModel:
    clean = tuple(
        OverviewRow(
            row.run,
            finite_or_none(row.sim_accuracy),
            finite_or_none(row.real_accuracy),
            _interval(row.sim_interval),
            _interval(row.real_interval),
            row.n,
            row.note,
            row.independent,
        )
        for row in rows
    )
    numbers = [finite_or_none(baseline)]
    for row in clean:
        numbers += [row.sim_accuracy, row.real_accuracy]
        numbers += [*(row.sim_interval or ()), *(row.real_interval or ())]
    if valid is not None:
        numbers += [1.0, *_lowest(columns, valid)]
    values = [value for value in numbers if value is not None]
    low, high = (min(values), max(values)) if values else (0.0, 1.0)
    width = tick_step(max(high - low, 0.02), 4)
    low, high = math.floor(low / width + 1e-9) * width, math.ceil(high / width - 1e-9) * width
    if high <= low:
        high = low + width
    return OverviewModel(
        clean, finite_or_none(baseline), (max(0.0, low), min(max(1.0, low + width), high))
    )


def _lowest(columns: tuple[Floats, ...], valid: Bools) -> list[float]:
    """The 1st percentile of the valid known accuracies of each run."""
    members = np.asarray(valid, dtype=np.bool_)
    known = (column[members & np.isfinite(column)] for column in columns)
    return [float(np.percentile(column, 1)) for column in known if column.size]


def _interval(interval: Interval | None) -> Interval | None:
    if interval is None:
        return None
    low, high = finite_or_none(interval[0]), finite_or_none(interval[1])
    return None if low is None or high is None else (min(low, high), max(low, high))


def overview_rows(
    store: Store, runs: Sequence[str] | None = None
) -> tuple[list[OverviewRow], float]:
    """A row per computed run, or per run in `runs`, and the baseline of the first run.

    Accuracies leave out the instances that the model was trained on.
    """
    rows = []
    for name in runs or [name for name, run in store.runs.items() if run.key]:
        sim, real = (run_metrics.side_metrics(store, name, side) for side in ("sim", "real"))
        rows.append(
            OverviewRow(
                run=name,
                sim_accuracy=sim.accuracy.value,
                real_accuracy=real.accuracy.value,
                sim_interval=(sim.accuracy.low, sim.accuracy.high),
                real_interval=(real.accuracy.low, real.accuracy.high),
                n=real.n,
                note=real.accuracy.no_bounds
                if real.n
                else "the model was trained on every instance",
                independent=sample.effective_n if (sample := real.accuracy.sample) else None,
                headlines=(headline(store, name, "sim"), headline(store, name, "real")),
            )
        )
    return rows, run_metrics.baseline_accuracy(store, rows[0].run) if rows else math.nan


def selected_parts(lines: OverviewLines) -> tuple[OverviewLines, OverviewLines | None]:
    """The lines with the new and with the trained instances selected; None where none is shown."""
    if lines.trained is None:
        return lines, None
    new, trained = (_selected_part(lines.selected, lines.trained, known) for known in (False, True))
    return replace(lines, selected=new, trained=None), replace(
        lines, selected=trained, trained=None
    )


@cached_by_identity(4)
def _selected_part(selected: Bools, trained: Bools, known: bool) -> Bools:
    return np.asarray(selected & (trained == known))


def cursor_accuracies(lines: OverviewLines) -> list[float | None]:
    """The accuracy of the cursor's instance in every run, None where unknown."""
    if lines.cursor is None:
        return [None] * len(lines.values)
    iid = lines.cursor
    return [
        finite_or_none(float(column[iid])) if 0 <= iid < len(column) else None
        for column in lines.values
    ]
