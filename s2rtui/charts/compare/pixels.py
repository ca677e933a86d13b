"""The difference map in true pixels: a triangle per cell, in the colour of its mean."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from s2rtui.canvas import legible
from s2rtui.canvas.pixel_marks import disc, draw_dots_by_level, highest_at, hollow, triangle
from s2rtui.charts.compare.model import (
    CompareInput,
    CompareModel,
    cell_means,
    change_signs,
    difference_colours,
)
from s2rtui.charts.shared.base_map_pixels import MapPicture
from s2rtui.charts.shared.point_bins import marked_cells

_STEPS = 100
"""Colours between no difference and one of full colour."""


def paint_compare(picture: MapPicture, data: CompareInput, model: CompareModel) -> None:
    """Paint the mean difference per cell, and the cursor.

    Triangles point down where the second run is better and up where the first is; discs mark cells
    within the margin. Shapes of several instances are larger, those with a trained one are hollow.
    """
    columns, rows, means, counts = cell_means(
        data.truth, data.first, data.second, model.selection, picture.frame
    )
    places = (np.stack([columns, rows], axis=1) + 0.5) * picture.cell
    share = np.clip(means / model.scale, -1, 1)
    levels = np.rint((share + 1) * _STEPS).astype(np.int16)
    colours = difference_colours(np.linspace(-1, 1, 2 * _STEPS + 1), 1.0)
    colours = legible(colours, picture.theme)
    signs, several = change_signs(means, data.equal), counts > 1
    trained = np.zeros(len(columns), dtype=np.bool_)
    if data.trained is not None:
        cells = marked_cells(data.truth, data.trained, model.selection, picture.frame)
        trained = cells[rows, columns]
    for sign, is_large, is_trained in product((0, -1, 1), (False, True), (False, True)):
        chosen = (signs == sign) & (several == is_large) & (trained == is_trained)
        radius = picture.radius * (1.3 if is_large else 0.9)
        shape = triangle(radius, up=sign > 0) if sign else disc(0.7 * radius)
        shape = hollow(shape) if is_trained else shape
        top = highest_at(places[chosen], levels[chosen], picture.image.shape[:2])
        draw_dots_by_level(picture.image, top, colours, shape, picture.theme.background)
    if model.cursor is not None:
        picture.pose("cursor", np.asarray(data.truth)[model.cursor], None)


def compare_key(data: CompareInput) -> tuple[object, ...]:
    """Everything that the picture depends on, except its frame and theme."""
    return (replace(data, mark=None, first_room=0),)
