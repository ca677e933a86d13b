"""Maps in true pixels: ground, points and poses as an image over the map's cells.

The image shows what the cells show, from the same arrays; texts stay in cells.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rstore.records import Room
from s2rtui.analysis.binning import SelectionIndices
from s2rtui.analysis.identity_cache import identity_key
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import Canvas, InlineImage, Pixels, Rgb, Size, Theme, legible, turbo
from s2rtui.canvas.canvas import BoolGrid
from s2rtui.canvas.pixel_marks import (
    diamond,
    disc,
    draw_dots_by_level,
    draw_dotted_lines,
    draw_lines,
    draw_ring,
    highest_at,
    hollow,
)
from s2rtui.canvas.raster import resample
from s2rtui.charts.shared.base_map_background import MapBackground, background_pixels
from s2rtui.charts.shared.base_map_model import MapInput, MapModel
from s2rtui.charts.shared.point_bins import LEVELS, level_of, level_shares
from s2rtui.drawing.scale import Floats

FEW, MANY = 1_500, 15_000
"""Up to `FEW` points dots have full size, above `MANY` they are as small as unselected ones."""


@dataclass(slots=True)
class MapPicture:
    """A map that is being drawn: `image` (h, w, 3), and the (width, height) of a cell in it."""

    image: Pixels
    frame: MapFrame
    theme: Theme
    cell: tuple[float, float]

    @property
    def radius(self) -> float:
        """The radius of a dot that fills a cell's width."""
        return max(1.5, 0.42 * min(self.cell[0], self.cell[1] / 2))

    def places(self, points: ArrayLike) -> NDArray[np.float64]:
        """(N, 2) pixels (column, row) of points in metres."""
        return self.frame.to_cells(points) * self.cell

    def dots(self, points: Floats, levels: ArrayLike, colours: Pixels, radius: float) -> None:
        """Draw outlined dots at points (N, 2) in the colours (n, 3) of their levels (N,)."""
        top = highest_at(self.places(points), levels, self.image.shape[:2])
        draw_dots_by_level(self.image, top, colours, disc(radius), self.theme.background)

    def role_marks(self, role: str, places: NDArray[np.float64]) -> None:
        """Draw the mark of a role at pixels (N, 2): sim filled, real hollow, truth a dot."""
        top = highest_at(places, 0, self.image.shape[:2])
        shapes = {"sim": diamond(self.radius + 1), "real": hollow(diamond(self.radius + 1.5))}
        shape = shapes.get(role, disc(max(1.5, 0.6 * self.radius)))
        colours = np.array([getattr(self.theme, role)], dtype=np.uint8)
        draw_dots_by_level(self.image, top, colours, shape, self.theme.background)

    def lines(self, starts: Floats, ends: Floats, colour: Rgb) -> None:
        """Draw lines between points (N, 2) and (N, 2); unknown ones are left out."""
        pairs = np.stack([self.places(starts), self.places(ends)], axis=1)
        known = pairs[np.isfinite(pairs).all(axis=(1, 2))]
        segments = [((a[0], a[1]), (b[0], b[1])) for a, b in known.tolist()]
        self.image = draw_lines(self.image, segments, colour, max(1, round(self.radius / 3)))

    def pose(self, role: str, point: Sequence[float] | Floats, heading: float | None) -> None:
        """Draw a ring in the colour of a role, with its heading where it is known."""
        x, y = self.places(np.asarray(point, dtype=np.float64)[None])[0].tolist()
        down = 1 if self.frame.y_down else -1
        if not np.isfinite([x, y]).all():
            return
        turn = None if heading is None or not np.isfinite(heading) else heading * down
        colour = getattr(self.theme, role)
        self.image = draw_ring(
            self.image, (x, y), colour, self.theme.background, self.radius + 1.5, turn
        )


def map_picture(
    ground: MapBackground,
    frame: MapFrame,
    theme: Theme,
    truth: Floats,
    selection: SelectionIndices,
    size: Size,
) -> MapPicture:
    """Ground, outlines of rooms and unselected points in `size` (height, width) pixels."""
    rows = frame.height // 2
    picture = MapPicture(
        _ground(ground, frame, theme, size), frame, theme, (size[1] / frame.width, size[0] / rows)
    )
    _draw_rooms(picture, ground.rooms)
    others = selection.base.copy()
    others[selection.members] = False
    points = np.asarray(truth)[others]
    top = highest_at(picture.places(points), 0, size)
    small = disc(max(0.5, picture.radius / 3))
    draw_dots_by_level(picture.image, top, np.array([theme.unselected], dtype=np.uint8), small)
    return picture


def _ground(ground: MapBackground, frame: MapFrame, theme: Theme, size: Size) -> Pixels:
    """Floor plan and heat in `size` (height, width), or the page colour without any."""
    if ground.floor_plan is None and ground.heat is None:
        return np.full((*size, 3), theme.background, dtype=np.uint8)
    cell = -(-size[0] * 2 // frame.height), -(-size[1] // frame.width)
    layer = background_pixels(ground, frame, theme, cell)
    return np.rint(resample(layer, *size)).astype(np.uint8)


def _draw_rooms(picture: MapPicture, rooms: Sequence[Room]) -> None:
    lines = []
    for room in rooms:
        corners = [[room.x0, room.y0], [room.x1, room.y0], [room.x1, room.y1], [room.x0, room.y1]]
        places = [(x, y) for x, y in picture.places(corners).tolist()]
        lines += list(zip(places, [*places[1:], places[0]], strict=True))
    draw_dotted_lines(picture.image, lines, picture.theme.muted)


def dot_radius(picture: MapPicture, count: int) -> float:
    """The radius of selected dots: smaller where there are many."""
    share = np.interp(np.log(max(1, count)), np.log([FEW, MANY]), [1.0, 0.4])
    return max(1.0, picture.radius * float(share))


def paint_values(picture: MapPicture, data: MapInput, model: MapModel) -> None:
    """Draw the selected points in the colours of their values, the largest on top."""
    theme, members = picture.theme, model.selection.members
    levels = level_of(np.asarray(data.values)[members], model.value_range)
    shares = level_shares(np.arange(LEVELS + 1))
    colours = legible(turbo(shares), theme)
    colours[0] = theme.text
    radius = dot_radius(picture, model.highlighted)
    picture.dots(np.asarray(data.truth)[members], levels, colours, radius)


def paint_trained(picture: MapPicture, data: MapInput, model: MapModel) -> None:
    """Draw a hole into the dots of selected instances that the model was trained on."""
    if data.trained is None:
        return
    members = model.selection.members
    places = picture.places(np.asarray(data.truth)[members[data.trained[members]]])
    top = highest_at(places, 0, picture.image.shape[:2])
    hole = disc(max(0.5, dot_radius(picture, model.highlighted) / 2))
    colour = np.array([picture.theme.background], dtype=np.uint8)
    draw_dots_by_level(picture.image, top, colour, hole)


def paint_cursor(picture: MapPicture, data: MapInput, cursor: int | None) -> None:
    """Draw the true pose of the cursor's instance."""
    if cursor is not None:
        heading = None if data.headings is None else float(data.headings[cursor])
        picture.pose("cursor", np.asarray(data.truth)[cursor], heading)


def add_picture(
    canvas: Canvas, key: tuple[object, ...], draw: Callable[[Size], Pixels], text: BoolGrid
) -> None:
    """Let a terminal with graphics draw an image over all cells of a canvas but its `text`.

    `key` is equal only for equal images; arrays in it count by identity.
    """
    shown = text if text.any() else None
    width, height = canvas.width, canvas.height
    canvas.images.append(InlineImage(0, 0, width, height, None, draw, identity_key(key), shown))
