"""Instances as lines across the runs of the overview: their density per braille dot, and drawing.

Accuracies of each run are binned once per axis, and the bins of neighbouring runs joined. A
selection is counted per pair of bins; every pair that occurs is drawn as one segment.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import cast

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis import joint_histogram
from s2rtui.analysis.binning import Bins, SelectionIndices, count_selected, selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import Canvas, ColourMode, Rgb, Theme, mix
from s2rtui.canvas.raster import cells_with_dots, draw_braille, line_dots
from s2rtui.charts.overview.bands import MOST_LINES, band_density, binned_quantiles
from s2rtui.charts.overview.layout import OverviewLayout, axis_share
from s2rtui.charts.overview.model import OverviewLines, cursor_accuracies, selected_parts
from s2rtui.drawing.scale import Floats, Interval

PIECE = 1 << 15
MANY = 20_000
"""Above this number of instances, wide charts use coarse bins, too."""
Density = NDArray[np.float64]
Counts = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class LineDensity:
    """Lines per braille dot, (4 rows, 2 columns per cell of the chart): selected, and others."""

    highlighted: Density
    others: Density


def line_density(lines: OverviewLines, axis: Interval, layout: OverviewLayout) -> LineDensity:
    """Segments or bands between neighbouring visible runs, or bars where rows are adjacent."""
    selection = selection_indices(np.asarray(lines.selected), np.asarray(lines.valid))
    shown = lines.values[layout.first : layout.first + layout.shown]
    arguments = shown, axis, layout.chart_width, layout.step, selection
    if layout.step == 1 or layout.shown == 1:
        return _bars(*arguments)
    counts = lines.counts
    segments: LineDensity | None = None
    bands: LineDensity | None = None
    if counts == (0, 0) or any(0 < count <= MOST_LINES for count in counts):
        segments = _segments(*arguments)
    if any(count > MOST_LINES for count in counts):
        bands = _bands(*arguments)
    if bands is None or segments is None:
        return cast(LineDensity, bands or segments)
    return LineDensity(
        bands.highlighted if lines.banded[0] else segments.highlighted,
        bands.others if lines.banded[1] else segments.others,
    )


@cached_by_identity(4)
def _segments(
    columns: tuple[Floats, ...], axis: Interval, width: int, step: int, selection: SelectionIndices
) -> LineDensity:
    """The density of segments from the middle of each run's row to the next one's."""
    size = bin_count(width, len(selection.base))
    parts: tuple[list[Density], list[Density]] = ([], [])
    for first, second in pairwise(columns):
        for part, table in zip(parts, _tables(first, second, axis, size, selection), strict=True):
            part.append(_spans(width, step, size).density(table[:size, :size].ravel()))
    edge = np.zeros((2, 2 * width))
    return LineDensity(*(np.concatenate([edge, *part, edge]) for part in parts))


@cached_by_identity(4)
def _bands(
    columns: tuple[Floats, ...], axis: Interval, width: int, step: int, selection: SelectionIndices
) -> LineDensity:
    """The bands of the selected and of the others, see `band_density`."""
    size = bin_count(width, len(selection.base))
    counted = joint_histogram.joint_counts(_bar_bins(columns, axis, size), selection)
    highlighted = np.stack([part for part, _ in counted])
    others = np.stack([total - part for part, total in counted])
    return LineDensity(
        *(band_density(binned_quantiles(part), width, step) for part in (highlighted, others))
    )


@cached_by_identity(4)
def _bars(
    columns: tuple[Floats, ...], axis: Interval, width: int, step: int, selection: SelectionIndices
) -> LineDensity:
    """The density as bars on each run's row, up to four dots high."""
    size = bin_count(width, len(selection.base))
    counted = joint_histogram.joint_counts(_bar_bins(columns, axis, size), selection)
    both = np.stack(
        [
            *(highlighted for highlighted, _ in counted),
            *(total - highlighted for highlighted, total in counted),
        ]
    )
    dots = _per_dot(both, width).reshape(2, len(columns), 2 * width)
    up = np.arange(4, 0, -1)[:, None]
    grids = (_heights(dots)[:, :, None] >= up) * dots[:, :, None]
    return LineDensity(*grids.reshape(2, 4 * len(columns), -1))


def _heights(dots: Density) -> Density:
    """Counts (2 parts, runs, dots) as heights 0 .. 4, 4 for the largest sum of both parts."""
    peak = int(dots.sum(axis=0).max())
    if peak > dots.size:
        return np.asarray(np.ceil(4 * levels(dots, peak)))
    return np.asarray(_heights_up_to(peak)[dots.astype(np.intp)])


@lru_cache(64)
def _heights_up_to(peak: int) -> Density:
    """(peak + 1,) by count."""
    return np.asarray(np.ceil(4 * levels(np.arange(peak + 1.0), peak)))


def pair_counts(lines: OverviewLines, axis: Interval, size: int) -> list[tuple[Counts, Counts]]:
    """Numbers of lines from bin to bin per pair of neighbouring runs: selected, and others.

    Each (size, size), with size up to 254; bin i covers part i of `size` equal parts of the axis.
    """
    selection = selection_indices(np.asarray(lines.selected), np.asarray(lines.valid))
    pairs = []
    for first, second in pairwise(lines.values):
        highlighted, others = _tables(first, second, axis, size, selection)
        pairs.append((highlighted[:size, :size], others[:size, :size]))
    return pairs


def _tables(
    first: Floats, second: Floats, axis: Interval, size: int, selection: SelectionIndices
) -> tuple[Counts, Counts]:
    """Counts per pair of bins, (size + 1, size + 1): selected, and others; the last is no bin."""
    highlighted, total = count_selected(_pairs(first, second, axis, size), selection)
    shape = (size + 1, size + 1)
    return highlighted.reshape(shape), (total - highlighted).reshape(shape)


def _per_dot(counts: Counts, width: int) -> Density:
    """Convert counts per bin (runs, bins) to counts per column of dots (runs, 2 width)."""
    dots, first = _dots(width, counts.shape[1])
    per_dot = np.zeros((len(counts), 2 * width))
    per_dot[:, dots] = np.add.reduceat(counts, first, axis=1)
    return per_dot


@lru_cache(8)
def _dots(width: int, size: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The columns of dots that contain bins, and the first bin of each."""
    at = np.floor(_places(width, size)).astype(np.intp)
    dots, first = np.unique(at, return_index=True)
    return dots, first


def levels(density: Density, peak: float) -> Density:
    """Convert counts to 0 .. 1 on a logarithmic scale, steeper for large peaks."""
    shares: Density = np.log1p(density) / np.log1p(max(peak, 1.0))
    return shares ** max(1.0, float(np.log10(max(peak, 1.0))) - 1)


def bin_count(chart_width: int, instances: int) -> int:
    """Number of bins of an accuracy axis: more on wide charts with few lines."""
    return 64 if instances > MANY or chart_width < 80 else 128


def _places(chart_width: int, size: int) -> Density:
    """The position of the middle of each bin in dots, (size,)."""
    return 2 * (0.5 + (np.arange(size) + 0.5) / size * (chart_width - 1))


@cached_by_identity(64)
def _binned(values: Floats, axis: Interval, size: int) -> NDArray[np.uint8]:
    """Bins of the axis, clipped to its ends; NaN gets bin `size`."""
    column = values
    codes = np.empty(len(column), dtype=np.uint8)
    scale = size / (axis[1] - axis[0])
    for start in range(0, len(column), PIECE):
        places = (column[start : start + PIECE] - axis[0]) * scale
        places = np.where(np.isnan(places), size, np.clip(places, 0, size - 1))
        codes[start : start + PIECE] = places
    return codes


@cached_by_identity(4)
def _bar_bins(columns: tuple[Floats, ...], axis: Interval, size: int) -> list[Bins]:
    return [Bins(_binned(column, axis, size), size) for column in columns]


@cached_by_identity(32)
def _pairs(first: Floats, second: Floats, axis: Interval, size: int) -> Bins:
    """Bins of two runs joined: code = first * (size + 1) + second; the last bin is none."""
    one, two = (_binned(part, axis, size) for part in (first, second))
    return Bins(one.astype(np.uint16) * np.uint16(size + 1) + two, (size + 1) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class _Spans:
    """The dots of the segment of each pair of bins, per row of dots.

    begin, end: (pairs, rows) flat indices of the first dot and of the dot after the last one, in a
    grid of `rows` x (`width` + 1).
    """

    begin: NDArray[np.int32]
    end: NDArray[np.int32]
    rows: int
    width: int

    def density(self, counts: NDArray[np.intp]) -> Density:
        """Lines per dot, (rows, width)."""
        held = np.flatnonzero(counts)
        weights = np.repeat(counts[held].astype(np.float64), self.rows)
        size = self.rows * (self.width + 1)
        steps = np.bincount(self.begin[held].ravel(), weights, minlength=size)
        steps -= np.bincount(self.end[held].ravel(), weights, minlength=size)
        grid = np.cumsum(steps.reshape(self.rows, self.width + 1), axis=1)
        return np.rint(grid[:, : self.width])


@lru_cache(4)
def _spans(chart_width: int, step: int, size: int) -> _Spans:
    """The segments from the middle of one run's row to the middle of the next one's."""
    rows, width = 4 * step, 2 * chart_width
    edges = _edges(chart_width, rows, size)
    low, high = np.minimum(edges[:, :-1], edges[:, 1:]), np.maximum(edges[:, :-1], edges[:, 1:])
    low += edges[:, 1:] < edges[:, :-1]
    high -= edges[:, 1:] > edges[:, :-1]
    base = np.arange(rows, dtype=np.int32) * (width + 1)
    return _Spans(low + base, np.minimum(high + 1, width) + base, rows, width)


def _edges(chart_width: int, rows: int, size: int) -> NDArray[np.int32]:
    """The dot of each segment at the upper edge of every row and at the lower edge of the last."""
    places = _places(chart_width, size)
    along = np.arange(rows + 1) / rows
    start, stop = places[:, None, None], places[None, :, None]
    return np.floor(start + (stop - start) * along).astype(np.int32).reshape(-1, rows + 1)


LIT_RAMP = "'+*#"


OTHER_RAMP = "."


PALE = 0.5
"""Strength of the colour of trained instances."""


DITHER = np.array([[0, 4], [6, 2], [1, 5], [7, 3]]) / 8
"""Thresholds of the dots of a cell: the denser a cell, the more of its dots are drawn."""


def draw_lines(
    canvas: Canvas, lines: OverviewLines, axis: Interval, layout: OverviewLayout
) -> None:
    """Draw all lines, then that of the cursor's instance."""
    new, trained = selected_parts(lines)
    density = line_density(new, axis, layout)
    chart = Canvas(layout.chart_width, layout.height, canvas.options)
    rows = slice(layout.top, layout.top + layout.height)
    chart.bg[:] = canvas.bg[rows, layout.chart : layout.chart + layout.chart_width]
    colour = getattr(canvas.theme, lines.side)
    others = (
        density if trained is None else line_density(replace(lines, trained=None), axis, layout)
    )
    _layer(chart, others.others, canvas.theme.unselected, OTHER_RAMP, faint=True)
    if trained is not None:
        shown = line_density(trained, axis, layout).highlighted
        _layer(chart, shown, pale_colour(colour, canvas.theme), canvas.glyphs.trained, faint=False)
    _layer(chart, density.highlighted, colour, LIT_RAMP, faint=False)
    if layout.step > 1 and lines.cursor is not None:
        _draw_cursor_line(chart, lines, axis, layout)
    canvas.paste(chart, layout.chart, layout.top)


def pale_colour(colour: Rgb, theme: Theme) -> Rgb:
    """The colour of lines of trained instances."""
    red, green, blue = mix(theme.background, colour, PALE).tolist()
    return red, green, blue


def _layer(canvas: Canvas, density: Density, colour: Rgb, ramp: str, faint: bool) -> None:
    """Draw dots where lines are, the denser the brighter."""
    peak = float(density.max(initial=0.0))
    if peak <= 0:
        return
    shares = levels(density, peak)
    cells = shares.reshape(canvas.height, 4, canvas.width, 2)
    per_cell = cells.max(axis=(1, 3))
    if canvas.options.ascii:
        steps = np.minimum(np.ceil(per_cell * len(ramp)), len(ramp)).astype(np.intp)
        rows, columns = np.nonzero(steps)
        canvas.char[rows, columns] = np.array(list(ramp))[steps[rows, columns] - 1]
        canvas.fg[rows, columns] = colour
        return
    strength = np.clip(np.log10(peak) - 1.5, 0, 1)
    dither = np.tile(DITHER, (canvas.height, canvas.width))
    dots = (density > 0) & (shares > 0.7 * strength * dither)
    if faint and canvas.options.mode is ColourMode.NONE:
        dots &= (np.indices(dots.shape).sum(axis=0) % 2).astype(np.bool_)
    low, high = (0.35, 0.75) if faint else (0.6, 1.0)
    draw_braille(canvas, dots, mix(canvas.theme.background, colour, low + (high - low) * per_cell))


def _draw_cursor_line(
    canvas: Canvas, lines: OverviewLines, axis: Interval, layout: OverviewLayout
) -> None:
    """The line of the cursor's instance, interrupted where it has no accuracy."""
    places = [
        _cell_of_accuracy(value, axis, layout, index)
        for index, value in enumerate(cursor_accuracies(lines)[layout.first :][: layout.shown])
    ]
    known = ((a, b) for a, b in pairwise(places) if a is not None and b is not None)
    grid = line_dots(known, canvas.width, canvas.height)
    if not canvas.options.ascii:
        draw_braille(canvas, grid, canvas.theme.cursor)
        return
    for row, column in np.argwhere(cells_with_dots(grid)).tolist():
        canvas.put(column, row, *canvas.options.role("cursor"), bold=True)


def _cell_of_accuracy(
    value: float | None, axis: Interval, layout: OverviewLayout, index: int
) -> tuple[float, float] | None:
    if value is None:
        return None
    share = min(1.0, max(0.0, axis_share(value, axis)))
    return 0.5 + share * (layout.chart_width - 1), index * layout.step + 0.5
