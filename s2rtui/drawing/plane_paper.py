"""Draw the marks of a plane, and points, on axes of matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import selection_indices
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import Pixels, legible, mix
from s2rtui.canvas.raster import cells_with_dots
from s2rtui.drawing.arcs import LARGEST, ErrorGlyphs, arc_overlap, arc_spans, error_glyphs
from s2rtui.drawing.figure_format import value_colours
from s2rtui.drawing.floor import floor_pixels
from s2rtui.drawing.heat_colours import change_colours
from s2rtui.drawing.page import Ink, Page
from s2rtui.drawing.plane_marks import (
    Arcs,
    Changes,
    Floor,
    Outlines,
    PlaneMark,
    Poses,
    ScaleBar,
    Segments,
    Signs,
    Unselected,
)
from s2rtui.drawing.plot import Phrase, Plot, Points
from s2rtui.drawing.points import (
    Grid,
    change_cells,
    change_signs,
    dot_bins,
    drawn_segments,
    point_cells,
    selected_count,
    sign_cells,
)
from s2rtui.drawing.scale import Floats, scale_fraction, short_number, tick_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes

POINTS_UP_TO = 40_000
"""Above this number of valid instances, cells are drawn in place of points."""
CELLS_PER_INCH = 11
"""Cells of the screen of a terminal in an inch of its true pixels."""
_FEW, _MANY = 5_000, 40_000
"""Above `_FEW` points they are small, above `_MANY` cells are drawn in their place."""
_PER_INCH = 36
"""Such cells per inch."""
_SEGMENTS_UP_TO = 200
"""Up to this number of selected instances, segments are drawn."""
_FOOTPRINT = {True: (4, 2), False: (7, 3)}
"""Cells by which arcs keep their distance, by whether it is a page or the screen."""
_RADIUS, _THICK = 11.0, 4.5
"""Points, of an arc."""
_ARROW, _RING = 15.0, 4.2
"""Points: length of the arrow of a pose, and its distance from the middle of a ring."""
_NAME, _SMALLEST_NAME = 8.0, 5.5
"""Font size of the name of a room, and the smallest one of a name in a small room."""
_LETTER, _LINE = 0.07, 0.16
"""Width of a letter of a room's name and height of its line, inches."""
_CHANGE_MARKERS = {0: "o", -1: "v", 1: "^"}
Size = tuple[float, float]


def draw_plane_mark(
    axes: Axes, page: Page, plot: Plot, mark: PlaneMark | Points, inches: Size, is_page: bool
) -> None:
    """Draw a mark of a plane of `inches`; on a page with the texts that a screen has in cells."""
    _DRAWINGS[type(mark)](_Sheet(axes, page, plot, inches, is_page), mark)


def plane_note(mark: PlaneMark | Points) -> tuple[Phrase, ...]:
    """What a mark shows, for the notes of a page."""
    if isinstance(mark, Unselected | Points):
        is_all = selected_count(mark.selected, mark.valid) == selected_count(mark.valid, mark.valid)
        return (*((Phrase("grey: not selected"),) * (not is_all)), *_trained_note(mark))
    if isinstance(mark, Arcs):
        wide = f"{LARGEST:g}° wide: {short_number(mark.full, 2)} m"
        phrases = [
            Phrase("truth", "truth", "truth"), Phrase("sim error", "sim", "sim"),
            Phrase("real error", "real", "real"), Phrase("both", "both", "both"), Phrase(wide),
        ]  # fmt: skip
        if selected_count(mark.selected, mark.valid) > 1:
            phrases.append(Phrase("number: mean of n instances"))
        return (*phrases, *_trained_note(mark))
    if isinstance(mark, Changes):
        below, within, above = mark.texts
        return (Phrase(below, "text", "below"), Phrase(above, "text", "above"),
                Phrase(within, "text", "selected"), *_trained_note(mark))  # fmt: skip
    if isinstance(mark, Signs):
        return _trained_note(mark)
    if isinstance(mark, Floor) and mark.seen is not None and not mark.is_plain:
        return (Phrase("dimmed: not seen by the selection"),)
    return ()


def _trained_note(mark: PlaneMark | Points) -> tuple[Phrase, ...]:
    has_trained = getattr(mark, "trained", None) is not None
    return (Phrase("hole: trained on"),) if has_trained else ()


class _Sheet:
    """The axes of a plot on a page; lengths in points are those on paper."""

    def __init__(self, axes: Axes, page: Page, plot: Plot, inches: Size, is_page: bool) -> None:
        self.axes, self.page, self.plot, self.inches = axes, page, plot, inches
        self.inks, self.is_page = page.inks, is_page
        self.span = abs(plot.x.high - plot.x.low), abs(plot.y.high - plot.y.low)
        self.per_point = self.span[0] / (72 * inches[0])
        """Units of the scales per point."""

    def grid(self, per_inch: float, shape: float = 1.0) -> Grid:
        """Cells of the plot, `shape` times as high as wide, of which an inch has `per_inch`."""
        width = max(1, round(self.inches[0] * per_inch))
        height = max(1, round(self.span[1] / self.span[0] * width / shape))
        return Grid(self.plot.x, self.plot.y, width, height)

    def places(self, cells: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
        """The points (k, 2) at columns and rows of cells (k, 2)."""
        x, y, width, height = grid
        return np.stack([x.value(cells[:, 0] / width), y.value(1 - cells[:, 1] / height)], axis=1)

    def shown(self, colours: Pixels) -> Pixels:
        """Colours of a scale; on the screen those of its cells, which stand out from the floor."""
        return colours if self.is_page else legible(colours, self.page.theme)

    def last_per_spot(self, x: Floats, y: Floats, ids: NDArray[np.intp]) -> NDArray[np.intp]:
        """Those of `ids` that are drawn, in their order: if they are many, the last of each spot.

        A spot is half a point wide.
        """
        if len(ids) <= _FEW:
            return ids
        spots = dot_bins(x, y, self.grid(72, 2.0))
        codes = spots.codes[ids][::-1]
        _, first = np.unique(codes, return_index=True)
        held = ids[np.sort(len(ids) - 1 - first)]
        return held[spots.codes[held] < spots.count]

    def dots(
        self, x: Floats, y: Floats, size: float, colour: Any, order: float, edge: float = 0.0,
        marker: str = "o", rim: Ink | None = None,
    ) -> None:  # fmt: skip
        """Markers of `size` square points with a rim that is `edge` points wide.

        Those in view are whole.
        """
        inside = np.ones(np.shape(x), dtype=np.bool_)
        for values, scale in ((x, self.plot.x), (y, self.plot.y)):
            inside &= (values >= min(scale.low, scale.high)) & (
                values <= max(scale.low, scale.high)
            )
        if len(colour) > 1:
            colour = np.asarray(colour)[inside]
        self.axes.scatter(x[inside], y[inside], s=size, marker=marker, c=colour, linewidths=edge,
                          zorder=order, clip_on=False,
                          edgecolors=[rim or self.inks.background])  # fmt: skip

    def cells(self, columns: Any, rows: Any, colours: Any, grid: Grid, order: float) -> None:
        """Cells of a grid in colours (k, 3), 0 .. 255."""
        image = np.zeros((grid.height, grid.width, 4), dtype=np.uint8)
        image[rows, columns] = np.column_stack([colours, np.full(len(colours), 255)])
        self.image(image, order)

    def image(self, pixels: Pixels, order: float) -> None:
        """An image that fills the axes."""
        x, y = self.plot.x, self.plot.y
        self.axes.imshow(pixels, extent=(x.low, x.high, y.low, y.high), interpolation="none",
                         aspect="auto", zorder=order)  # fmt: skip


def _draw_floor(sheet: _Sheet, floor: Floor) -> None:
    """Floor, heat and walls; on a page paler, so that marks of all colours stand out."""
    if floor.is_plain:
        return
    width, height = (max(1, round(side * sheet.page.figure.dpi)) for side in sheet.inches)
    x, y = sheet.plot.x, sheet.plot.y
    frame = MapFrame(
        x.low, y.high, sheet.span[0] / width, width, height, sheet.plot.y_down
    )  # fmt: skip
    layer = floor_pixels(floor, frame, sheet.page.theme)
    opaque = np.full((*layer.shape[:2], 1), 255, dtype=np.uint8)
    sheet.image(np.concatenate([layer, opaque], axis=2), 0)


def _draw_outlines(sheet: _Sheet, outlines: Outlines) -> None:
    """Dashed outlines, and on a page each name once, no larger than its room."""
    from matplotlib.collections import PolyCollection

    corners = [
        [(room.x0, room.y0), (room.x1, room.y0), (room.x1, room.y1), (room.x0, room.y1)]
        for room in outlines.rooms
    ]
    sheet.axes.add_collection(PolyCollection(
        corners, facecolors="none", edgecolors=[sheet.inks.muted], linewidths=0.8,
        linestyles=[(0, (4, 3))], zorder=2.5,
    ))  # fmt: skip
    if not sheet.is_page:
        return
    scale, named = sheet.inches[0] / sheet.span[0], set[str]()
    for room in outlines.rooms:
        if room.room in named:
            continue
        named.add(room.room)
        wide, high = (room.x1 - room.x0) * scale, (room.y1 - room.y0) * scale
        words = room.room.split() if len(room.room) * _LETTER > wide else [room.room]
        fits = min(wide / (_LETTER * max(map(len, words))), high / (_LINE * len(words)))
        size = _NAME * min(1.0, fits)
        if size < _SMALLEST_NAME:
            continue
        top = room.y0 if sheet.plot.y_down else room.y1
        sheet.axes.annotate(
            "\n".join(words), (room.x0, top), xytext=(4, -4), textcoords="offset points",
            ha="left", va="top", fontsize=size, color=sheet.inks.muted, zorder=6,
            annotation_clip=True, path_effects=sheet.page.halo(2.5),
        )  # fmt: skip


def _draw_unselected(sheet: _Sheet, mark: Unselected) -> None:
    selection = selection_indices(mark.selected, mark.valid)
    others = selection.indices
    if not selection.inverted:
        inside = selection.base.copy()
        inside[others] = False
        others = np.flatnonzero(inside)
    if len(others) > _MANY:
        grid = sheet.grid(_PER_INCH)
        cells = sign_cells(Signs(mark.x, mark.y, ~mark.selected, mark.valid), grid)
        colours = np.tile(np.array(sheet.page.theme.unselected), (len(cells.rows), 1))
        sheet.cells(cells.columns, cells.rows, colours, grid, 3)
        return
    held = sheet.last_per_spot(mark.x, mark.y, others)
    sheet.dots(mark.x[held], mark.y[held], 5, [sheet.inks.unselected], 3)


def _draw_signs(sheet: _Sheet, signs: Signs) -> None:
    """Each instance, the largest value on top, smaller where they are many; at last cells."""
    theme = sheet.page.theme
    members = selection_indices(signs.selected, signs.valid).members
    if len(members) > _MANY:
        grid = sheet.grid(_PER_INCH)
        cells = sign_cells(signs, grid)
        colours = _value_colours(sheet, cells.values)
        if signs.values is None:
            colours[:] = getattr(theme, signs.ink)
        sheet.cells(cells.columns, cells.rows, colours, grid, 5)
        return
    if signs.values is not None:
        shares = scale_fraction(signs.values[members], signs.scale)
        members = members[np.argsort(np.nan_to_num(shares, nan=-1.0), kind="stable")]
    held = sheet.last_per_spot(signs.x, signs.y, members)
    x, y, small = signs.x[held], signs.y[held], 0.2 if len(members) > _FEW else 1.0
    ink = getattr(sheet.inks, signs.ink)
    if signs.values is not None:
        shares = scale_fraction(signs.values[held], signs.scale)
        sheet.dots(x, y, 26 * small, _value_colours(sheet, shares) / 255, 5, 0.6 * (small == 1))
    elif signs.sign == "real":
        sheet.dots(x, y, 20 * small, [sheet.inks.background], 5, 1.1 * small, "D", ink)
    else:
        order, marker = (6, "o") if signs.sign == "truth" else (5, "D")
        sheet.dots(x, y, 20 * small, [ink], order, 0.6 * small * (order == 6), marker)
    _draw_holes(sheet, signs, members)


def _draw_points(sheet: _Sheet, points: Points) -> None:
    """Each instance, the highest level on top; where they are many, cells of their mean level."""
    inks, selection = sheet.inks, selection_indices(points.selected, points.valid)
    shares = (np.arange(points.depth) + 0.5) / points.depth
    levels = [getattr(inks, ink) for ink in points.inks] or value_colours(shares) / 255.0
    colours = np.vstack([[inks.muted], levels])
    if selected_count(points.valid, points.valid) > POINTS_UP_TO:
        grid = Grid(sheet.plot.x, sheet.plot.y, *(max(4, int(24 * side)) for side in sheet.inches))
        cells = point_cells(points, grid)
        image = np.zeros((grid.height, grid.width, 4))
        image[cells_with_dots(cells.grey)] = (*inks.unselected, 0.6)
        held = cells.level >= 0
        image[held, :3] = colours[cells.level[held]]
        share = np.log(cells.count[held]) / max(np.log(cells.count.max(initial=1)), 1e-9)
        image[held, 3] = (
            0.3 + 0.7 * share if points.inks else 1.0
        )  # classes: the denser the stronger
        sheet.image(np.rint(255 * image).astype(np.uint8), 2)
    else:
        members = selection.members
        others = points.valid.copy()
        others[members] = False
        sheet.dots(points.x[others], points.y[others], 6, [inks.unselected], 2)
        if not points.inks:
            members = members[np.argsort(points.levels[members], kind="stable")]
        x, y = points.x[members], points.y[members]
        sheet.dots(x, y, 24, colours[points.levels[members]], 4, 0.5)
        _draw_holes(sheet, points, members)
    if points.cursor is not None:
        place = float(points.x[points.cursor]), float(points.y[points.cursor]), None
        _draw_poses(sheet, Poses((place,), "cursor", "cursor"))


def _value_colours(sheet: _Sheet, shares: NDArray[np.float64]) -> Pixels:
    colours = sheet.shown(value_colours(shares))
    colours[~np.isfinite(shares)] = sheet.page.theme.muted
    return colours


def _draw_holes(
    sheet: _Sheet, mark: Signs | Changes | Arcs | Points, members: NDArray[np.intp]
) -> None:
    """A hole in the marks of the instances that the model was trained on."""
    if mark.trained is not None:
        held = sheet.last_per_spot(mark.x, mark.y, members[mark.trained[members]])
        size = 2 if len(members) > _FEW else 9
        sheet.dots(mark.x[held], mark.y[held], size, [sheet.inks.background], 7)


def _draw_changes(sheet: _Sheet, changes: Changes) -> None:
    """A triangle for each instance, the largest change on top; where they are many, cells."""
    members = selection_indices(changes.selected, changes.valid).members
    members = members[np.isfinite(changes.values[members])]
    if len(members) > _MANY:
        grid = sheet.grid(_PER_INCH)
        cells = change_cells(changes, grid)
        colours = sheet.shown(change_colours(cells.values / changes.scale))
        sheet.cells(cells.columns, cells.rows, colours, grid, 5)
        return
    members = members[np.argsort(np.abs(changes.values[members]), kind="stable")]
    held = sheet.last_per_spot(changes.x, changes.y, members)
    values = changes.values[held]
    which = change_signs(values, changes.margin)
    colours = sheet.shown(change_colours(values / changes.scale))
    size, edge = (34, 0.6) if len(members) <= _FEW else (5, 0.0)
    for order, sign in enumerate(_CHANGE_MARKERS):
        part = held[which == sign]
        sheet.dots(changes.x[part], changes.y[part], size, colours[which == sign] / 255,
                   5 + order / 10, edge, _CHANGE_MARKERS[sign])  # fmt: skip
    _draw_holes(sheet, changes, members)


def _draw_segments(sheet: _Sheet, segments: Segments) -> None:
    from matplotlib.collections import LineCollection

    ids = drawn_segments(segments, sheet.grid(CELLS_PER_INCH, 2.0), _SEGMENTS_UP_TO)
    ends = [np.stack([part[ids] for part in end], axis=1) for end in (segments.start, segments.end)]
    lines = np.stack(ends, axis=1)
    known = list(lines[np.isfinite(lines).all(axis=(1, 2))])
    sheet.axes.add_collection(LineCollection(
        known, colors=[getattr(sheet.inks, segments.ink)], linewidths=0.7,
        alpha=0.55 if len(ids) <= 40 else 0.3, zorder=4,
    ))  # fmt: skip


def _draw_arcs(sheet: _Sheet, arcs: Arcs) -> None:
    """Errors as arcs of sim and real, whose overlap has a third colour, around small dots."""
    from matplotlib.collections import PolyCollection

    inks = sheet.inks
    grid = sheet.grid(CELLS_PER_INCH, 2.0)
    glyphs = error_glyphs(arcs, grid, _FOOTPRINT[sheet.is_page])
    members = selection_indices(arcs.selected, arcs.valid).members
    size, alpha = (1, 0.25) if glyphs.is_crowded else (6, 1.0)
    tint = mix(sheet.page.theme.background, sheet.page.theme.truth, alpha)
    if len(members) > _MANY:
        fine = sheet.grid(_PER_INCH)
        shown = sign_cells(Signs(arcs.x, arcs.y, arcs.selected, arcs.valid), fine)
        sheet.cells(shown.columns, shown.rows, np.tile(tint, (len(shown.rows), 1)), fine, 4)
    else:
        held = sheet.last_per_spot(arcs.x, arcs.y, members)
        sheet.dots(arcs.x[held], arcs.y[held], size, [tint / 255], 4)
    if not glyphs.is_crowded:
        _draw_holes(sheet, arcs, members)
    cells = glyphs.centres if sheet.is_page else np.floor(glyphs.centres) + 0.5
    centres = sheet.places(cells, grid)
    spans = [arc_spans(part, arcs.full) for part in (glyphs.sim, glyphs.real)]
    for order, (low, high), colour in (
        (5.0, spans[0], inks.sim), (5.1, spans[1], inks.real), (5.2, arc_overlap(*spans), inks.both)
    ):  # fmt: skip
        known = np.flatnonzero(high > low)
        outlines = list(_sectors(centres[known], low[known], high[known], sheet.per_point))
        sheet.axes.add_collection(PolyCollection(
            outlines, facecolors=[colour], edgecolors=[inks.background], linewidths=0.5,
            zorder=order,
        ))  # fmt: skip
    for vectors, rim, face in ((glyphs.sim, inks.sim, inks.sim), (glyphs.real, inks.real, None)):
        turns = np.arctan2(vectors[:, 1], vectors[:, 0])
        steps = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        tips = centres + (_RADIUS - _THICK / 2) * sheet.per_point * steps
        sheet.dots(tips[:, 0], tips[:, 1], 10, [face or inks.background], 5.5, 1.0, "D", rim)
    if sheet.is_page:
        _draw_numbers(sheet, glyphs, centres)


def _draw_numbers(sheet: _Sheet, glyphs: ErrorGlyphs, centres: NDArray[np.float64]) -> None:
    """A dot for one instance, else the number of combined ones."""
    alone = glyphs.counts == 1
    sheet.dots(centres[alone, 0], centres[alone, 1], 12, [sheet.inks.truth], 6)
    ink = sheet.inks.truth if sheet.page.theme.dark else sheet.inks.text
    for place, count in zip(centres[~alone].tolist(), glyphs.counts[~alone].tolist(), strict=True):
        sheet.axes.annotate(
            str(count) if count < 1000 else f"{count // 1000}k", place, ha="center", va="center",
            fontsize=6, fontweight="bold", color=ink, zorder=6, annotation_clip=True,
            path_effects=sheet.page.halo(2),
        )  # fmt: skip


def _sectors(
    centres: NDArray[np.float64], low: Floats, high: Floats, per_point: float
) -> NDArray[np.float64]:
    """(k, n, 2) the outlines of arcs around points (k, 2), between angles (k,) in degrees."""
    angles = np.radians(low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 24))
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * per_point
    edges = [_RADIUS * circle, (_RADIUS - _THICK) * circle[:, ::-1]]
    return np.asarray(centres[:, None] + np.concatenate(edges, axis=1))


def _draw_poses(sheet: _Sheet, poses: Poses) -> None:
    """A ring where the pose has a sign, and an arrow in the direction of the heading."""
    ink = getattr(sheet.inks, poses.ink)
    if poses.sign is not None:
        x, y, _ = np.array(poses.places, dtype=float).reshape(-1, 3).T
        sheet.dots(x, y, 70, ["none"], 7, 1.6, rim=ink)
    headed = [(x, y, turn) for x, y, turn in poses.places if turn is not None]
    if not headed:
        return
    x, y, turn = np.array(headed).T
    step, before = _ARROW * sheet.per_point, _RING * sheet.per_point * (poses.sign is not None)
    across, up = np.cos(turn), np.sin(turn)
    sheet.axes.quiver(
        x + before * across, y + before * up, step * across, step * up, angles="xy",
        scale_units="xy", scale=1, units="dots", width=1.6 * sheet.page.figure.dpi / 72,
        headwidth=4, headlength=4, headaxislength=3.6, color=[ink],
        edgecolor=sheet.inks.background, linewidth=0.5, zorder=8,
    )  # fmt: skip


def _draw_scale_bar(sheet: _Sheet, bar: ScaleBar) -> None:
    """On a page, a bar of round length in the lower left corner."""
    if not sheet.is_page:
        return
    x, y = sheet.plot.x, sheet.plot.y
    length = tick_step(sheet.span[0] / 5, 1)
    if length > sheet.span[0] / 3:
        length = tick_step(sheet.span[0] / 10, 1)
    left, low = float(x.value(0.03)), float(y.value(0.03))
    ink = sheet.inks.text
    sheet.axes.plot(
        [left, left + length], [low, low], color=ink, linewidth=2.2, solid_capstyle="butt",
        zorder=9, path_effects=sheet.page.halo(4.5),
    )  # fmt: skip
    sheet.axes.annotate(
        f"{short_number(length)} m", (left + length / 2, low), xytext=(0, 4), ha="center",
        va="bottom", textcoords="offset points", fontsize=8, color=ink, zorder=9,
        path_effects=sheet.page.halo(2.5),
    )  # fmt: skip


_DRAWINGS: dict[type, Callable[[_Sheet, Any], None]] = {
    Floor: _draw_floor, Outlines: _draw_outlines, Unselected: _draw_unselected, Signs: _draw_signs,
    Changes: _draw_changes, Segments: _draw_segments, Arcs: _draw_arcs, Poses: _draw_poses,
    ScaleBar: _draw_scale_bar, Points: _draw_points,
}  # fmt: skip
