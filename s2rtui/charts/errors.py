"""The errors view: histograms of the position errors of both sides on one scale, sim above real."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES, Side
from s2rtui.analysis.binning import (
    Bins,
    Bools,
    bin_values,
    joint_counts,
    median_selected,
    selection_indices,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.charts.mark_expressions import cell_width, number_text, range_expression, round_to_cell
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.planes import cursor_phrases, valid_cursor
from s2rtui.charts.view import Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Bars, Dots, Mark, Phrase, Plot, Rule
from s2rtui.drawing.scale import Floats, Scale, short_number

FINE = 250
"""About this number of bins is counted and merged for the bars; fine bins give fast medians."""
_BINS = 20
"""Bins of the table of numbers; the last one includes all larger errors."""
Counts = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Histogram:
    """One side: counts (bins,) of the selected and of all valid instances, median of the selected.

    beyond: number of valid errors above the last edge; they count in the last bin.
    """

    part: Counts
    whole: Counts
    median: float
    beyond: int

    @property
    def counted(self) -> str:
        return f"{int(self.part.sum())} of {int(self.whole.sum())}"


@dataclass(frozen=True, slots=True, eq=False)
class ErrorsModel:
    """Both histograms. edges: (bins + 1,) metres, from 0 to the 99th percentile of both sides."""

    edges: NDArray[np.float64]
    sides: dict[Side, Histogram]


@cached_by_identity(8)
def errors_model(
    sim: Floats, real: Floats, selected: Bools, valid: Bools, bins: int
) -> ErrorsModel:
    """Count the position errors (N,) of both sides in metres in common bins."""
    upper = _upper(sim, real, valid)
    columns = [_bins(side, upper, bins * max(1, FINE // bins)) for side in (sim, real)]
    counted = joint_counts(columns, selection_indices(selected, valid))
    sides = zip(SIDES, (sim, real), columns, counted, strict=True)
    histograms = {
        side: Histogram(
            part.reshape(bins, -1).sum(axis=1), whole.reshape(bins, -1).sum(axis=1),
            median_selected(errors, column, part, selected, valid), _beyond(errors, upper, valid),
        )
        for side, errors, column, (part, whole) in sides
    }  # fmt: skip
    return ErrorsModel(np.linspace(0.0, upper, bins + 1), histograms)


@cached_by_identity(16)
def _upper(sim: Floats, real: Floats, valid: Bools) -> float:
    """The 99th percentile of the known valid errors; 1 without any, or where all are zero."""
    both = np.concatenate([np.asarray(side)[np.asarray(valid)] for side in (sim, real)])
    both = both[np.isfinite(both)]
    return (float(np.percentile(both, 99)) if both.size else 0.0) or 1.0


@cached_by_identity(32)
def _bins(errors: Floats, upper: float, count: int) -> Bins:
    column = np.asarray(errors, dtype=np.float64)
    places = np.clip(column / upper * count, 0, np.nextafter(count, 0))
    return bin_values(np.where(np.isfinite(column), places, np.nan), count)


@cached_by_identity(16)
def _beyond(errors: Floats, upper: float, valid: Bools) -> int:
    return int(np.count_nonzero(np.isfinite(errors) & (errors > upper) & valid))


def errors_plots(model: ErrorsModel, cursor: dict[Side, float]) -> tuple[Plot, ...]:
    """A histogram per side with the median of the selected; `cursor`: errors of one instance."""
    upper = float(model.edges[-1])
    names = ("position error (m)", "error (m)", "m")
    if any(side.beyond for side in model.sides.values()):
        last = short_number(upper)
        names = (f"position error (m), last bar: {last} and more",
                 f"error (m), last bar: {last}+", "error (m)")  # fmt: skip
    x = Scale(0.0, upper, names)
    peak = float(max(1, *(int(side.whole.max()) for side in model.sides.values())))
    y = Scale(0.0, peak, ("instances",), fixed=((0.0, "0"), (peak, f"{peak:.0f}")))
    plots = []
    for side, histogram in model.sides.items():
        marks: list[Mark] = [Bars(model.edges, histogram.part, histogram.whole, side)]
        title = f"median {short_number(histogram.median)} m"
        if math.isfinite(histogram.median):
            marks.append(Rule(histogram.median, ink="text", dashed=True))
        if math.isfinite(error := cursor.get(side, math.nan)):
            at = np.array([min(error, upper)])
            marks.append(Dots(at, np.zeros(1), "cursor"))
        titles = Phrase(side, side, side), Phrase(title, "text"), Phrase(histogram.counted)
        plots.append(Plot(x, y, tuple(marks), side, titles))
    return tuple(plots)


class ErrorsView(View):
    name = "errors"
    key = "7"
    description = "histogram of the position errors"
    about = "position error of the selection"
    title = "position errors in simulation and in reality"

    def input(self, scene: Scene) -> tuple[Floats, Floats, Bools, Bools]:
        state = scene.state
        columns = scene.store.run_columns(state.run)
        return columns.sim.error, columns.real.error, state.selected, state.base

    def _cursor(self, scene: Scene) -> dict[Side, float]:
        """The errors of the cursor's instance, if it is in view."""
        cursor = valid_cursor(scene.state.cursor, scene.state.base)
        if cursor is None:
            return {}
        return dict(
            zip(SIDES, (float(side[cursor]) for side in self.input(scene)[:2]), strict=True)
        )

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        model = errors_model(*self.input(scene), max(1, columns))
        legend = Phrase("grey: all instances"), Phrase("dashes: median", "text")
        cursor = cursor_phrases(valid_cursor(scene.state.cursor, scene.state.base))
        plots = errors_plots(model, self._cursor(scene))
        return Drawing(plots, notes=((*legend, *cursor),), brush=scene.mark(self.name))

    def numbers(self, scene: Scene) -> Table:
        model = errors_model(*self.input(scene), _BINS)
        ends = model.edges.tolist()
        counts = (histogram.part.tolist() for histogram in model.sides.values())
        return ("from_m", "to_m", *SIDES), list(zip(ends, ends[1:], *counts, strict=False))

    def summary(self, scene: Scene) -> str:
        medians = []
        for side, errors in zip(SIDES, self.input(scene)[:2], strict=True):
            known = errors[scene.state.selected & np.isfinite(errors)]
            if known.size:
                medians.append(f"{side} {np.median(known):.2f} m, at most {known.max():.2f} m")
        return f"Median position error: {'; '.join(medians) or 'none'}."

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        error = self._cursor(scene).get("sim" if panel.name == "sim" else "real", math.nan)
        return (error, 0.0) if math.isfinite(error) else None

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        field = f"{panel.name}.error"
        low, high = sorted(point[0] for point in (mark.points[0], mark.points[-1]))
        if high > panel.to_data(panel.x + panel.width - 1, 0)[0]:
            lowest = max(0.0, round_to_cell(low, cell_width(panel)))
            return f"{field} >= {number_text(lowest)}"  # the last bar has no upper end
        return range_expression(panel, mark, field, 0.0)


VIEW = ErrorsView()
