"""The map in true pixels: values, predictions or error glyphs on the floor plan."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas import mix
from s2rtui.canvas.pixel_marks import arc_pixels, disc, draw_dots_by_level, highest_at
from s2rtui.charts.map.model import (
    ErrorGlyphs,
    arc_degrees,
    arc_turns,
    error_glyphs,
    iids_with_error_lines,
)
from s2rtui.charts.shared.base_map_model import MapInput, MapModel
from s2rtui.charts.shared.base_map_pixels import (
    MapPicture,
    dot_radius,
    paint_cursor,
    paint_trained,
    paint_values,
)
from s2rtui.drawing.scale import Floats

GLYPH_FOOTPRINT = (7, 3)
"""Columns and rows of cells that an error glyph takes."""
_RADIUS, _THICKNESS = 1.8, 0.5
"""Radius and thickness of an arc in widths of a cell."""
COUNTS = "23456789+②③④⑤⑥⑦⑧⑨⊕"
"""Characters of the number of combined glyphs, also with a trained instance; they stay texts."""


def paint_map(picture: MapPicture, data: MapInput, model: MapModel) -> None:
    """Paint the selected in the map's mode, live predictions and the cursor."""
    PAINTINGS[data.mode](picture, data, model)
    paint_trained(picture, data, model)
    for planned in data.planned:
        place = (planned.x_m, planned.y_m)
        picture.pose("planned", place, math.radians(planned.heading_deg))
    for pose in data.live:
        picture.pose(pose.side, (pose.x, pose.y), pose.heading)
    if data.mode == "full" and model.cursor is not None:
        _cursor_predictions(picture, data, model.cursor)
    paint_cursor(picture, data, model.cursor)


def map_key(data: MapInput) -> tuple[object, ...]:
    """Everything that the picture depends on, except its frame and theme."""
    return (replace(data, mark=None),)


def _cursor_predictions(picture: MapPicture, data: MapInput, cursor: int) -> None:
    for role, points, headings in (
        ("sim", data.sim, data.sim_headings),
        ("real", data.real, data.real_headings),
    ):
        heading = None if headings is None else float(headings[cursor])
        picture.pose(role, np.asarray(points)[cursor], heading)


def _paint_predictions(picture: MapPicture, data: MapInput, model: MapModel) -> None:
    """Predictions and truth of the selected, joined by lines where they are few."""
    ids, members = iids_with_error_lines(data, model, picture.frame), model.selection.members
    sides: tuple[tuple[Floats, Floats, str], ...] = (
        (data.true_positions("sim"), data.sim, "sim"),
        (data.true_positions("real"), data.real, "real"),
    )
    for start, end, role in sides:
        colour = getattr(picture.theme, role)
        picture.lines(np.asarray(start)[ids], np.asarray(end)[ids], colour)
    for role in ("sim", "real", "truth"):
        picture.role_marks(role, picture.places(np.asarray(getattr(data, role))[members]))


def _paint_error_glyphs(picture: MapPicture, data: MapInput, model: MapModel) -> None:
    """Errors as arcs around the true positions."""
    theme, shape = picture.theme, picture.image.shape[:2]
    glyphs = error_glyphs(data, model, picture.frame, GLYPH_FOOTPRINT)
    colour = mix(theme.background, theme.truth, 0.55 if glyphs.crowded else 1.0)
    places = picture.places(np.asarray(data.truth)[model.selection.members])
    radius = 0.6 * dot_radius(picture, model.highlighted)
    top = highest_at(places, 0, shape)
    draw_dots_by_level(picture.image, top, colour[None], disc(radius), theme.background)
    sim, real = (_arcs(picture, glyphs, part, data.y_down) for part in (glyphs.sim, glyphs.real))
    picture.image[sim], picture.image[real] = theme.sim, theme.real
    picture.image[sim & real] = theme.both
    for role, vectors in (("sim", glyphs.sim), ("real", glyphs.real)):
        picture.role_marks(role, _tips(picture, glyphs, vectors, data.y_down))


def _middles(picture: MapPicture, glyphs: ErrorGlyphs) -> NDArray[np.float64]:
    """(k, 2) pixels: the middles of the glyphs' cells, where their numbers stand."""
    return (np.floor(glyphs.centres) + 0.5) * picture.cell


def _arcs(
    picture: MapPicture, glyphs: ErrorGlyphs, vectors: NDArray[np.float64], y_down: bool
) -> NDArray[np.bool_]:
    """The pixels of the arcs of one side."""
    turns, widths = np.degrees(arc_turns(vectors, y_down)), arc_degrees(vectors, glyphs.full)
    known = np.isfinite(turns)
    arcs = [
        ((x, y), turn, width)
        for (x, y), turn, width in zip(
            _middles(picture, glyphs)[known].tolist(),
            turns[known].tolist(),
            widths[known].tolist(),
            strict=True,
        )
    ]
    thickness = max(2, round(_THICKNESS * picture.cell[0]))
    height, width = picture.image.shape[:2]
    return arc_pixels((height, width), arcs, _RADIUS * picture.cell[0], thickness)


def _tips(
    picture: MapPicture, glyphs: ErrorGlyphs, vectors: NDArray[np.float64], y_down: bool
) -> NDArray[np.float64]:
    """(k, 2) pixels: the middle of each arc."""
    turns = arc_turns(vectors, y_down)
    step = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    return _middles(picture, glyphs) + _RADIUS * picture.cell[0] * step


PAINTINGS = {
    "colour": paint_values, "glyph": _paint_error_glyphs, "full": _paint_predictions
}  # fmt: skip
"""How the selected are painted, per map mode."""
