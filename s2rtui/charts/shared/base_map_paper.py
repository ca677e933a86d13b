"""Maps on paper: background, rooms, axes, scale bar, legend, and points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds, Room
from s2rtui.analysis.binning import SelectionIndices
from s2rtui.analysis.map_frame import MapFrame, fit_frame
from s2rtui.canvas import Rgb, Theme, luma, mix, turbo
from s2rtui.canvas.raster import resample
from s2rtui.charts.shared.axis_scale import (
    Floats,
    scale_fraction,
    short_number,
    tick_step,
    tick_values,
)
from s2rtui.charts.shared.base_map_background import DIMMED, MapBackground, heat_scale, seen_cells
from s2rtui.charts.shared.base_map_model import MapInput, MapModel, sorted_by_value
from s2rtui.charts.shared.paper import (
    Box,
    Page,
    draw_heading,
    new_figure,
    rgb_fractions,
    style_axes,
    wrapped_label,
)
from s2rtui.charts.shared.points import point_dots

if TYPE_CHECKING:
    from matplotlib.axes import Axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patheffects import AbstractPathEffect

SIDE = 1.75
"""Width of colour bars and legend at the right, inches."""
LETTER = 0.07
"""Width of a letter of a room's name, inches."""
MANY = 5000
"""Above this number, points are drawn smaller, and one per spot of half a point."""


@dataclass(frozen=True, slots=True)
class Spots:
    """A grid so fine that one mark per spot looks the same as all of them."""

    frame: MapFrame
    theme: Theme

    def last(self, points: Floats, ids: NDArray[np.intp]) -> NDArray[np.intp]:
        """Indices into `ids`, ascending: the last one of each spot; all if they are few."""
        if len(ids) <= MANY:
            return np.arange(len(ids))
        places = point_dots(np.asarray(points), self.frame)
        codes = places.codes[ids][::-1]
        _, first = np.unique(codes, return_index=True)
        held = np.sort(len(ids) - 1 - first)
        return held[places.codes[ids[held]] < places.count]

    def thinned(self, points: Floats, ids: NDArray[np.intp]) -> NDArray[np.intp]:
        """`ids` reduced to one per spot."""
        return ids[self.last(points, ids)]


@dataclass(frozen=True, slots=True, eq=False)
class MapSheet:
    """A map on a figure. inches: its size; side: upper left corner of the legend, inches."""

    figure: Figure
    page: Page
    axes: Axes
    area: Bounds
    inches: tuple[float, float]
    spots: Spots
    side: tuple[float, float] | None

    def grid(self, points: float) -> MapFrame:
        """A frame whose cells are `points` (1/72 inch) wide and twice as high."""
        wide, high = (max(1, int(length * 72 / points)) for length in self.inches)
        return fit_frame(self.area, wide, high + high % 2, self.spots.frame.y_down)


def map_sheet(
    ground: MapBackground, area: Bounds, page: Page, title: str, subtitle: str
) -> MapSheet:
    """A new figure with a map as large as the page allows."""
    figure = new_figure(page)
    top = draw_heading(figure, page, title, subtitle)
    wide, _ = page.inches
    side = SIDE if wide > 4.5 else 0.0
    room = (max(wide - 0.75 - side - 0.2, 0.3), max(top - 0.6, 0.3))
    scale = min(room[0] / area.width, room[1] / area.height)
    inches = area.width * scale, area.height * scale
    left = 0.75
    corner = (left + inches[0] + 0.3, top) if side else None
    return map_panel(figure, page, ground, area, (left, top - inches[1], *inches), corner)


def map_panel(
    figure: Figure,
    page: Page,
    ground: MapBackground,
    area: Bounds,
    box: Box,
    side: tuple[float, float] | None = None,
) -> MapSheet:
    """Draw a map in a rectangle of the area's shape: left, bottom, width, height in inches."""
    inches = box[2], box[3]
    axes = figure.add_axes(page.box(*box))
    _picture(axes, ground, page, inches[0])
    _axes(axes, ground, area, page, inches)
    _rooms(axes, ground, page.theme, inches[0] / area.width)
    _scale(axes, area, ground.y_down, page.theme)
    points = [max(1, int(length * 72)) for length in inches]
    fine = fit_frame(area, points[0], points[1], ground.y_down)
    return MapSheet(figure, page, axes, area, inches, Spots(fine, page.theme), side)


def marker_legend(
    sheet: MapSheet, marks: list[tuple[str, str, Rgb, bool]], corner: tuple[float, float]
) -> None:
    """Name, marker, colour and whether it is filled, one under the other from `corner`."""
    from matplotlib.lines import Line2D

    if not marks:
        return
    handles = [
        Line2D(
            [],
            [],
            linestyle="none",
            marker=marker,
            markersize=6,
            color=rgb_fractions(ink),
            markerfacecolor=rgb_fractions(ink) if filled else "none",
            label=wrapped_label(name),
        )
        for name, marker, ink, filled in marks
    ]
    inches = sheet.page.inches
    legend = sheet.figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=((corner[0] - 0.12) / inches[0], (corner[1] - 0.05) / inches[1]),
        frameon=False,
        fontsize=9,
        handletextpad=0.3,
        borderaxespad=0,
    )
    for text in legend.get_texts():
        text.set_color(rgb_fractions(sheet.page.theme.text))


def _picture(axes: Axes, ground: MapBackground, page: Page, inches: float) -> None:
    """Pale floor plan with heat; unseen floor dimmed."""
    theme, bounds = page.theme, ground.bounds
    if bounds.width <= 0 or bounds.height <= 0:
        return
    extent = (bounds.x0, bounds.x1, bounds.y0, bounds.y1)
    if ground.floor_plan is not None:
        limit = max(16, int(inches * page.dpi))
        rows, columns = ground.floor_plan.shape[:2]
        shrink = min(1.0, limit / max(rows, columns))
        floor = resample(ground.floor_plan, int(rows * shrink), int(columns * shrink))
        grey = np.repeat((luma(floor) * 255)[..., None], 3, axis=-1)
        muted = 0.5 * floor + 0.5 * grey
        picture = mix(np.array(theme.background), muted, 0.5)
        if not ground.y_down:
            picture = picture[::-1]
        axes.imshow(
            picture, extent=extent, origin="lower", interpolation="antialiased", aspect="auto"
        )
    if ground.heat is not None and (scale := heat_scale(ground)) is not None:
        shares = scale_fraction(ground.heat, scale)
        opacity = np.where(np.isfinite(shares), 0.15 + 0.7 * np.nan_to_num(shares) ** 0.7, 0.0)
        layer = np.dstack([turbo(shares) / 255.0, opacity])
        axes.imshow(layer, extent=extent, origin="lower", interpolation="nearest", aspect="auto")
    if ground.clip is not None:
        hidden = DIMMED * (1 - seen_cells(np.asarray(ground.clip)))
        layer = np.dstack(
            [np.broadcast_to(rgb_fractions(theme.background), (*hidden.shape, 3)), hidden]
        )
        axes.imshow(layer, extent=extent, origin="lower", interpolation="nearest", aspect="auto")


def _axes(
    axes: Axes, ground: MapBackground, area: Bounds, page: Page, inches: tuple[float, float]
) -> None:
    style_axes(axes, page.theme)
    axes.set_xlim(area.x0, area.x1)
    axes.set_ylim((area.y1, area.y0) if ground.y_down else (area.y0, area.y1))
    axes.set_xticks(tick_values(area.x0, area.x1, max(2, int(inches[0] / 0.7))))
    axes.set_yticks(tick_values(area.y0, area.y1, max(2, int(inches[1] / 0.7))))
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    for spine in axes.spines.values():
        spine.set_visible(True)


def _rooms(axes: Axes, ground: MapBackground, theme: Theme, scale: float) -> None:
    """Dashed outlines of rooms, with each name once. `scale`: inches per metre."""
    from matplotlib.patches import Rectangle

    named: set[str] = set()
    for room in ground.rooms:
        outline = Rectangle(
            (room.x0, room.y0),
            room.x1 - room.x0,
            room.y1 - room.y0,
            fill=False,
            edgecolor=rgb_fractions(theme.muted),
            linewidth=0.8,
            linestyle=(0, (4, 3)),
            zorder=2.5,
        )
        axes.add_patch(outline)
        if room.room not in named:
            named.add(room.room)
            _name(axes, room, room.y0 if ground.y_down else room.y1, theme, scale)


def _name(axes: Axes, room: Room, top: float, theme: Theme, scale: float) -> None:
    """A room's name in its upper left corner, wrapped where the room is narrow."""
    from matplotlib import patheffects

    halo: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=2.5, foreground=rgb_fractions(theme.background))
    ]
    broad = len(room.room) * LETTER > (room.x1 - room.x0) * scale
    label = axes.annotate(
        room.room.replace(" ", "\n") if broad else room.room,
        (room.x0, top),
        xytext=(4, -4),
        textcoords="offset points",
        ha="left",
        va="top",
        fontsize=8,
        color=rgb_fractions(theme.muted),
        zorder=6,
        annotation_clip=True,
    )
    label.set_path_effects(halo)


def _scale(axes: Axes, area: Bounds, y_down: bool, theme: Theme) -> None:
    """A scale bar of round length in the lower left corner."""
    from matplotlib import patheffects

    length = tick_step(area.width / 5, 1)
    if length > area.width / 3:
        length = tick_step(area.width / 10, 1)
    x = area.x0 + 0.03 * area.width
    y = area.y1 - 0.03 * area.height if y_down else area.y0 + 0.03 * area.height
    halo: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=4.5, foreground=rgb_fractions(theme.background))
    ]
    axes.plot(
        [x, x + length],
        [y, y],
        color=rgb_fractions(theme.text),
        linewidth=2.2,
        solid_capstyle="butt",
        zorder=9,
        path_effects=halo,
    )
    label = axes.annotate(
        f"{short_number(length)} m",
        (x + length / 2, y),
        xytext=(0, 4),
        textcoords="offset points",
        ha="center",
        va="bottom",
        fontsize=8,
        color=rgb_fractions(theme.text),
        zorder=9,
    )
    halo_text: list[AbstractPathEffect] = [
        patheffects.withStroke(linewidth=2.5, foreground=rgb_fractions(theme.background))
    ]
    label.set_path_effects(halo_text)


def draw_unselected(axes: Axes, truth: Floats, selection: SelectionIndices, spots: Spots) -> None:
    """Draw unselected poses as small grey dots."""
    others = selection.indices if selection.inverted else _outside(selection)
    grey = np.asarray(truth, dtype=np.float64)[spots.thinned(truth, others)]
    ink = rgb_fractions(spots.theme.unselected)
    axes.scatter(grey[:, 0], grey[:, 1], s=5, color=ink, linewidths=0, zorder=3)


def _outside(selection: SelectionIndices) -> NDArray[np.intp]:
    inside = selection.base.copy()
    inside[selection.indices] = False
    return np.flatnonzero(inside)


def draw_values(axes: Axes, data: MapInput, model: MapModel, spots: Spots) -> None:
    """Draw the selected points coloured by value, the largest on top."""
    ids, shares = sorted_by_value(data, model)
    held = spots.last(data.truth, ids)
    highlighted, shares = np.asarray(data.truth, dtype=np.float64)[ids[held]], shares[held]
    ink = turbo(shares) / 255.0
    ink[~np.isfinite(shares)] = rgb_fractions(spots.theme.muted)
    draw_dots(axes, highlighted, ink, spots)


def draw_dots(axes: Axes, points: Floats, ink: NDArray[np.float64], spots: Spots) -> None:
    """Draw dots with an edge in the page's colour; smaller above `MANY`."""
    edge = rgb_fractions(spots.theme.background)
    many = len(points) > MANY
    size, width = (5, 0.0) if many else (26, 0.6)
    axes.scatter(
        points[:, 0], points[:, 1], s=size, c=ink, edgecolors=[edge], linewidths=width, zorder=5
    )


def draw_pose(
    axes: Axes, points: Floats, headings: Floats | None, iid: int, colour: Rgb, area: Bounds
) -> None:
    """Draw a ring at one of `points` (N, 2), and an arrow where its heading is known."""
    x, y = (float(part) for part in np.asarray(points)[iid])
    if not np.isfinite([x, y]).all():
        return
    ink, length = rgb_fractions(colour), 0.035 * max(area.width, area.height)
    axes.scatter([x], [y], s=70, facecolors="none", edgecolors=[ink], linewidths=1.6, zorder=7)
    if headings is not None and np.isfinite(headings[iid]):
        angle = float(headings[iid])
        tip = (x + length * np.cos(angle), y + length * np.sin(angle))
        arrow = {"arrowstyle": "-|>", "color": ink, "lw": 1.6, "shrinkA": 4, "shrinkB": 0}
        axes.annotate("", xy=tip, xytext=(x, y), arrowprops=arrow, zorder=8)
