"""Maps on paper: background, rooms, axes, scale bar, legend, and points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.binning import SelectionIndices
from s2rtui.analysis.map_frame import MapFrame, fit_frame
from s2rtui.canvas import luma, mix
from s2rtui.canvas.raster import resample
from s2rtui.charts.shared.base_map_background import DIMMED, MapBackground, heat_scale, seen_cells
from s2rtui.charts.shared.base_map_model import MapInput, MapModel, sorted_by_value
from s2rtui.charts.shared.point_bins import point_dots
from s2rtui.drawing.heat_colours import heat_ramp, map_opacity
from s2rtui.drawing.page import (
    NARROW,
    Box,
    Ink,
    Page,
    draw_ring,
    style_plane,
    value_colours,
    wrapped_label,
)
from s2rtui.drawing.scale import Floats, scale_fraction, short_number, tick_step

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LegendMark = tuple[str, str, Ink, bool]
"""Name, marker, colour, and whether the marker is filled."""
SIDE = 1.85
"""Width of colour bars and legend at the right, inches."""
LETTER, LINE = 0.07, 0.16
"""Width of a letter of a room's name and height of its line, inches."""
MANY = 5000
"""Above this number, points are drawn smaller, and one per spot of half a point."""


@dataclass(frozen=True, slots=True, eq=False)
class MapSheet:
    """A map of `area` (metres) on a page, and the upper left corner of its legend.

    inches: width and height of the map. spots: a grid so fine that one mark per spot looks the
    same as all of them.
    """

    page: Page
    axes: Axes
    area: Bounds
    inches: tuple[float, float]
    spots: MapFrame
    side: tuple[float, float] | None

    def last_per_spot(self, points: Floats, ids: NDArray[np.intp]) -> NDArray[np.intp]:
        """Indices into `ids`, ascending: the last one of each spot; all if they are few."""
        if len(ids) <= MANY:
            return np.arange(len(ids))
        places = point_dots(np.asarray(points), self.spots)
        codes = places.codes[ids][::-1]
        _, first = np.unique(codes, return_index=True)
        held = np.sort(len(ids) - 1 - first)
        return held[places.codes[ids[held]] < places.count]

    def thinned(self, points: Floats, ids: NDArray[np.intp]) -> NDArray[np.float64]:
        """The `points` (N, 2) of `ids`, reduced to one per spot."""
        return np.asarray(points, dtype=np.float64)[ids[self.last_per_spot(points, ids)]]

    def grid(self, points: float) -> MapFrame:
        """A frame whose cells are `points` (1/72 inch) wide and twice as high."""
        wide, high = (max(1, int(length * 72 / points)) for length in self.inches)
        return fit_frame(self.area, wide, high + high % 2, self.spots.y_down)


def map_sheet(ground: MapBackground, area: Bounds, page: Page, below: float = 0.0) -> MapSheet:
    """A map as large as the page allows; legends of a narrow page take `below` inches under it."""
    is_narrow = page.inches[0] <= NARROW
    side, below = (0.0, below) if is_narrow else (SIDE, 0.0)
    room = (max(page.inches[0] - 0.75 - side - 0.2, 0.3), max(page.top - 0.6 - below, 0.3))
    scale = min(room[0] / area.width, room[1] / area.height)
    inches = area.width * scale, area.height * scale
    corner = (0.75 + inches[0] + 0.3, page.top)
    if is_narrow:
        corner = (0.3, page.top - inches[1] - 0.55)
    return map_panel(
        page, ground, area, (0.75, page.top - inches[1], *inches), corner if below or side else None
    )


def map_panel(
    page: Page,
    ground: MapBackground,
    area: Bounds,
    box: Box,
    side: tuple[float, float] | None = None,
) -> MapSheet:
    """Draw a map in a rectangle of the area's shape: left, bottom, width, height in inches."""
    inches, axes = box[2:], page.axes(*box)
    _draw_background(axes, ground, page, inches[0])
    ends = (area.y1, area.y0) if ground.y_down else (area.y0, area.y1)
    style_plane(axes, page, (area.x0, area.x1, *ends), inches)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    _draw_rooms(axes, ground, page, inches[0] / area.width)
    _draw_scale_bar(axes, area, ground.y_down, page)
    points = [max(1, int(length * 72)) for length in inches]
    spots = fit_frame(area, points[0], points[1], ground.y_down)
    return MapSheet(page, axes, area, inches, spots, side)


def marker_legend(page: Page, marks: list[LegendMark], corner: tuple[float, float]) -> None:
    """Draw the marks with their names, one under the other from `corner` (inches)."""
    from matplotlib.lines import Line2D

    if not marks:
        return
    handles = [
        Line2D(
            [], [], linestyle="none", marker=marker, markersize=6, color=ink,
            markerfacecolor=ink if filled else "none", label=wrapped_label(name, 21),
        )
        for name, marker, ink, filled in marks
    ]  # fmt: skip
    inches = page.inches
    page.figure.legend(
        handles=handles, loc="upper left", frameon=False, fontsize=9, handletextpad=0.3,
        bbox_to_anchor=((corner[0] - 0.12) / inches[0], (corner[1] - 0.05) / inches[1]),
        borderaxespad=0, labelcolor=page.inks.text,
    )  # fmt: skip


def _draw_background(axes: Axes, ground: MapBackground, page: Page, inches: float) -> None:
    """Pale floor plan with heat; unseen floor dimmed."""
    theme, bounds = page.theme, ground.bounds
    if bounds.width <= 0 or bounds.height <= 0:
        return

    def show(layer: NDArray[np.generic], interpolation: str = "nearest") -> None:
        extent = (bounds.x0, bounds.x1, bounds.y0, bounds.y1)
        axes.imshow(
            layer, extent=extent, origin="lower", interpolation=interpolation, aspect="auto"
        )

    if ground.floor_plan is not None:
        limit = max(16, int(inches * page.figure.dpi))
        rows, columns = ground.floor_plan.shape[:2]
        shrink = min(1.0, limit / max(rows, columns))
        floor = resample(ground.floor_plan, int(rows * shrink), int(columns * shrink))
        grey = np.repeat((luma(floor) * 255)[..., None], 3, axis=-1)
        pale = mix(np.array(theme.background), 0.5 * floor + 0.5 * grey, 0.5)
        show(pale if ground.y_down else pale[::-1], "antialiased")
    if ground.heat is not None and (scale := heat_scale(ground)) is not None:
        shares = scale_fraction(ground.heat, scale)
        colours = heat_ramp(ground.heat_is_signed, value_colours)(shares)
        show(np.dstack([colours / 255.0, map_opacity(shares, ground.heat_is_signed)]))
    if ground.clip is not None:
        hidden = DIMMED * (1 - seen_cells(np.asarray(ground.clip)))
        show(np.dstack([np.broadcast_to(page.inks.background, (*hidden.shape, 3)), hidden]))


def _draw_rooms(axes: Axes, ground: MapBackground, page: Page, scale: float) -> None:
    """Dashed outlines of rooms, with each name once. `scale`: inches per metre.

    On pages of paper, a name that is larger than its room is left out.
    """
    from matplotlib.patches import Rectangle

    named: set[str] = set()
    ink = page.inks.muted
    for room in ground.rooms:
        wide, high = room.x1 - room.x0, room.y1 - room.y0
        axes.add_patch(
            Rectangle(
                (room.x0, room.y0), wide, high, fill=False, edgecolor=ink, linewidth=0.8,
                linestyle=(0, (4, 3)), zorder=2.5,
            )
        )  # fmt: skip
        if room.room in named:
            continue
        named.add(room.room)
        is_narrow = len(room.room) * LETTER > wide * scale
        words = room.room.split() if is_narrow else [room.room]
        longest = max(map(len, words), default=0) * LETTER
        if page.is_paper and (longest > wide * scale or len(words) * LINE > high * scale):
            continue
        axes.annotate(
            room.room.replace(" ", "\n") if is_narrow else room.room,
            (room.x0, room.y0 if ground.y_down else room.y1), xytext=(4, -4),
            textcoords="offset points", ha="left", va="top", fontsize=8, color=ink, zorder=6,
            annotation_clip=True, path_effects=page.halo(2.5),
        )  # fmt: skip


def _draw_scale_bar(axes: Axes, area: Bounds, y_down: bool, page: Page) -> None:
    """A scale bar of round length in the lower left corner."""
    length = tick_step(area.width / 5, 1)
    if length > area.width / 3:
        length = tick_step(area.width / 10, 1)
    x = area.x0 + 0.03 * area.width
    y = area.y1 - 0.03 * area.height if y_down else area.y0 + 0.03 * area.height
    ink = page.inks.text
    axes.plot(
        [x, x + length], [y, y], color=ink, linewidth=2.2, solid_capstyle="butt", zorder=9,
        path_effects=page.halo(4.5),
    )  # fmt: skip
    axes.annotate(
        f"{short_number(length)} m", (x + length / 2, y), xytext=(0, 4), ha="center", va="bottom",
        textcoords="offset points", fontsize=8, color=ink, zorder=9, path_effects=page.halo(2.5),
    )  # fmt: skip


def draw_unselected(sheet: MapSheet, truth: Floats, selection: SelectionIndices) -> None:
    """Draw unselected poses as small grey dots."""
    inside = selection.base.copy()
    inside[selection.indices] = False
    others = selection.indices if selection.inverted else np.flatnonzero(inside)
    grey = sheet.thinned(truth, others)
    ink = sheet.page.inks.unselected
    sheet.axes.scatter(grey[:, 0], grey[:, 1], s=5, color=ink, linewidths=0, zorder=3)


def draw_values(sheet: MapSheet, data: MapInput, model: MapModel) -> None:
    """Draw the selected points coloured by value, the largest on top; smaller above `MANY`."""
    ids, shares = sorted_by_value(data, model)
    held = sheet.last_per_spot(data.truth, ids)
    points, shares = np.asarray(data.truth, dtype=np.float64)[ids[held]], shares[held]
    colours = value_colours(shares) / 255.0
    colours[~np.isfinite(shares)] = sheet.page.inks.muted
    size, width = (5, 0.0) if len(points) > MANY else (26, 0.6)
    edge = [sheet.page.inks.background]
    sheet.axes.scatter(
        points[:, 0], points[:, 1], s=size, c=colours, edgecolors=edge, linewidths=width, zorder=5
    )


def draw_trained(sheet: MapSheet, data: MapInput, model: MapModel) -> None:
    """A hole in the marks of the selected instances that the model was trained on."""
    if data.trained is None:
        return
    ids = model.selection.members
    x, y = sheet.thinned(data.truth, ids[data.trained[ids]]).T
    hole = [sheet.page.inks.background]
    sheet.axes.scatter(x, y, s=2 if len(ids) > MANY else 9, color=hole, linewidths=0, zorder=7)


def draw_pose(sheet: MapSheet, points: Floats, headings: Floats | None, iid: int, ink: Ink) -> None:
    """Draw a ring at one of `points` (N, 2), and an arrow where its heading is known."""
    x, y = (float(part) for part in np.asarray(points)[iid])
    if not np.isfinite([x, y]).all():
        return
    axes, length = sheet.axes, 0.035 * max(sheet.area.width, sheet.area.height)
    draw_ring(axes, x, y, ink, 70, 7)
    if headings is not None and np.isfinite(headings[iid]):
        angle = float(headings[iid])
        tip = (x + length * np.cos(angle), y + length * np.sin(angle))
        arrow = {"arrowstyle": "-|>", "color": ink, "lw": 1.6, "shrinkA": 4, "shrinkB": 0}
        axes.annotate("", xy=tip, xytext=(x, y), arrowprops=arrow, zorder=8)
