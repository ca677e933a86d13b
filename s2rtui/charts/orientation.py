"""The orientation view: the headings of the selection predicted in sim, true, predicted in real."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES
from s2rtui.analysis.binning import (
    Bins,
    Bools,
    SelectionIndices,
    bin_values,
    joint_counts,
    selection_indices,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.canvas.marks import wrap_degrees
from s2rtui.charts.mark_expressions import heading_expression
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.planes import cursor_phrases, valid_cursor
from s2rtui.charts.view import Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Bars, Dots, Mark, Phrase, Plot
from s2rtui.drawing.scale import Floats, Scale, short_number, tick_values

BINS = 72
"""Bins of dials and of the numbers, of 5 degrees."""
EXACTLY_UP_TO = 20_000
"""Up to this number, mean directions are exact; above it they are computed from bins."""
Name = Literal["sim", "truth", "real"]
NAMES: tuple[Name, ...] = ("sim", "truth", "real")
_FIELDS = {"sim": "sim.heading", "truth": "heading", "real": "real.heading"}
Counts = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class Headings:
    """Counts (bins,) of the selected and of all valid instances; circular mean of the selected.

    mean: degrees, -180 .. 180. resultant: length of the mean unit vector, 0 .. 1; both NaN where
    none is selected.
    """

    part: Counts
    whole: Counts
    mean: float
    resultant: float


@dataclass(frozen=True, slots=True, eq=False)
class OrientationModel:
    """The headings in common bins. edges: (bins + 1,) degrees from -180 to 180.

    peak: count of a bar of full length. share: selected share of all. Grey bars show all instances
    times this share: the bars of a selection that is independent of the heading.
    """

    edges: NDArray[np.float64]
    headings: dict[Name, Headings]
    peak: int
    share: float


@cached_by_identity(16)
def turn_bins(angles: NDArray[np.floating], count: int) -> Bins:
    """The bin of each angle (N,) in radians, of `count` bins from -180 degrees on; NaN: none."""
    turned = np.degrees(np.asarray(angles, dtype=np.float64)) + 180
    turned = (turned - 360 * np.floor(turned / 360)) / 360 * count
    return bin_values(np.where(turned >= count, 0.0, turned), count)


def mean_direction(
    angles: NDArray[np.floating], counts: NDArray[np.intp], selection: SelectionIndices
) -> complex:
    """The mean unit vector of the selected angles; NaN without any.

    counts: (n,) the selected in each of n bins of `turn_bins`.
    """
    number = int(counts.sum())
    if number == 0:
        return complex(math.nan, math.nan)
    if number > EXACTLY_UP_TO:
        return complex((counts * _directions(angles, counts.size)).sum() / number)
    units = np.exp(1j * np.asarray(angles[selection.members], dtype=np.float64))
    return complex(units[np.isfinite(units)].mean())


@cached_by_identity(16)
def _directions(angles: NDArray[np.floating], count: int) -> NDArray[np.complex128]:
    """(count,) the mean unit vector of all angles in each bin, in single precision."""
    column = np.asarray(angles, dtype=np.float32)
    codes = turn_bins(angles, count).codes
    known = np.where(codes < count, column, 0.0)
    cosines = np.bincount(codes, np.cos(known), count + 1)[:count]
    sines = np.bincount(codes, np.sin(known), count + 1)[:count]
    number = np.maximum(np.bincount(codes, minlength=count + 1)[:count], 1)
    return np.asarray((cosines + 1j * sines) / number)


@cached_by_identity(8)
def orientation_model(
    sides: tuple[Floats, Floats, Floats], selected: Bools, valid: Bools, bins: int = BINS
) -> OrientationModel:
    """Count headings (N,) in radians (sim, true, real; NaN for none) and compute their means."""
    selection, fine = selection_indices(selected, valid), bins * -(-BINS // bins)
    columns = [turn_bins(side, fine) for side in sides]
    counted = joint_counts(columns, selection)
    headings: dict[Name, Headings] = {}
    for name, side, (part, whole) in zip(NAMES, sides, counted, strict=True):
        mean = mean_direction(side, part, selection)
        headings[name] = Headings(
            part.reshape(bins, -1).sum(axis=1), whole.reshape(bins, -1).sum(axis=1),
            math.degrees(np.angle(mean)), abs(mean),
        )  # fmt: skip
    number = sum(int(each.part.sum()) for each in headings.values())
    share = number / sum(int(each.whole.sum()) for each in headings.values()) if number else 1.0
    longest = max(float(each.whole.max()) * share for each in headings.values())
    peak = max(1, math.ceil(longest), *(int(each.part.max()) for each in headings.values()))
    return OrientationModel(np.linspace(-180.0, 180.0, bins + 1), headings, peak, share)


def orientation_plots(
    model: OrientationModel, cursor: dict[Name, float], y_down: bool
) -> tuple[Plot, ...]:
    """A dial per column of headings; `cursor`: degrees of one instance. y_down: 90 is below."""
    names = [f"max {short_number(model.peak, 2)}"]
    if (whole := short_number(model.peak / model.share, 2)) != short_number(model.peak, 2):
        names.insert(0, f"{names[0]} (all {whole})")
    rings = [tick for tick in tick_values(0, model.peak, 3) if tick > 0 and tick == round(tick)]
    y = Scale(0.0, model.peak, tuple(names), fixed=tuple((ring, f"{ring:.0f}") for ring in rings))
    x = Scale(-180.0, 180.0, fixed=tuple((turn, str(turn)) for turn in range(-180, 181, 90)))
    plots = []
    for name, each in model.headings.items():
        marks: list[Mark] = [Bars(model.edges, each.part, each.whole * model.share, name)]
        if name in cursor:
            marks.append(Dots(np.array([cursor[name]]), np.array([y.high]), "cursor"))
        mean = Phrase("none selected", short="none")
        if math.isfinite(each.mean):
            text = f"{int(wrap_degrees(round(each.mean)))}° R {each.resultant:.2f}"
            mean = Phrase(f"mean {text}", short=text)
        plots.append(Plot(x, y, tuple(marks), name, (Phrase(name, name, name), mean), shape="turn",
                          turns="clockwise" if y_down else "anticlockwise"))  # fmt: skip
    return tuple(plots)


class OrientationView(View):
    name = "orientation"
    key = "5"
    description = "headings in bins of 5 degrees: sim, truth, real"
    title = "headings in simulation, in truth and in reality"
    paper_columns = BINS
    figure_size = (1600, 720)

    def subtitle(self, scene: Scene) -> str:
        store, run = scene.store, scene.store.run(scene.state.run)
        own = [side for side in SIDES if run.domain(side) in store.domains_with_own_poses]
        note = f"; {' and '.join(own)} images have true headings of their own" if own else ""
        return f"headings (R: 1 = all alike){note}"

    def input(self, scene: Scene) -> tuple[tuple[Floats, Floats, Floats], Bools, Bools]:
        state, columns = scene.state, scene.store.run_columns(scene.state.run)
        sides = columns.sim.heading, scene.store.instances.heading, columns.real.heading
        return sides, state.selected, state.base

    def _cursor(self, scene: Scene) -> dict[Name, float]:
        """The headings of the cursor's instance in degrees, if it is in view."""
        cursor = valid_cursor(scene.state.cursor, scene.state.base)
        if cursor is None:
            return {}
        turns = {name: math.degrees(side[cursor])
                 for name, side in zip(NAMES, self.input(scene)[0], strict=True)}  # fmt: skip
        return {name: wrap_degrees(turn) for name, turn in turns.items() if math.isfinite(turn)}

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        model = orientation_model(*self.input(scene), columns // max(1, columns // BINS))
        plots = orientation_plots(model, self._cursor(scene), scene.store.dataset.y_down)
        cursor = cursor_phrases(valid_cursor(scene.state.cursor, scene.state.base))
        notes = ((Phrase("grey: all instances"), *cursor),)
        return Drawing(plots, notes=notes, brush=scene.mark(self.name), beside=True)

    def paper_drawing(self, scene: Scene) -> Drawing:
        model = orientation_model(*self.input(scene))
        note = f"bars: selected instances per 5°, rim = {model.peak}"
        if model.share < 1:
            note += f"; of grey bars, rim = {short_number(model.peak / model.share, 2)}"
        drawing = self.drawing(scene, BINS)
        return replace(drawing, notes=(*drawing.notes, f"{note}; R: resultant length"))

    def numbers(self, scene: Scene) -> Table:
        model = orientation_model(*self.input(scene))
        ends = model.edges.astype(int).tolist()
        counts = (each.part.tolist() for each in model.headings.values())
        return ("from_deg", "to_deg", *NAMES), list(zip(ends, ends[1:], *counts, strict=False))

    def summary(self, scene: Scene) -> str:
        means = [
            f"{name} {each.mean:.0f} degrees (resultant length {each.resultant:.2f})"
            for name, each in orientation_model(*self.input(scene)).headings.items()
            if math.isfinite(each.mean)
        ]
        return f"Mean headings: {', '.join(means) or 'none'}."

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        turns = self._cursor(scene).items()
        return next(((turn, 0.0) for name, turn in turns if name == panel.name), None)

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        return heading_expression(mark, _FIELDS[panel.name])


VIEW = OrientationView()
