"""The difference map in true pixels: a triangle per cell, in the colour of its mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from s2rtui.canvas import legible
from s2rtui.canvas.pixel_marks import disc, draw_dots_by_level, highest_at, triangle
from s2rtui.charts.compare.model import (
    CompareInput,
    CompareModel,
    better_run,
    cell_means,
    difference_colours,
)
from s2rtui.charts.shared.base_map_pixels import MapPicture

_STEPS = 100
"""Colours between no difference and one of full colour."""


def paint_compare(picture: MapPicture, data: CompareInput, model: CompareModel) -> None:
    """Paint the mean difference per cell, and the cursor.

    Triangles point up where the second run is better and down where the first is; discs mark cells
    within the margin. Half of the full colour or more makes them larger.
    """
    columns, rows, means = cell_means(
        data.truth, data.first, data.second, model.selection, picture.frame
    )
    places = (np.stack([columns, rows], axis=1) + 0.5) * picture.cell
    share = np.clip(means / model.scale, -1, 1)
    levels = np.rint((share + 1) * _STEPS).astype(np.int16)
    colours = difference_colours(np.linspace(-1, 1, 2 * _STEPS + 1), 1.0)
    colours = legible(colours, picture.theme)
    better, large = better_run(means, data.equal), np.abs(share) > 0.5
    for sign in (0, -1, 1):
        for is_large in (False, True):
            chosen = (better == sign) & (large == is_large)
            radius = picture.radius * (1.3 if is_large else 0.9)
            shape = triangle(radius, up=sign > 0) if sign else disc(0.7 * radius)
            top = highest_at(places[chosen], levels[chosen], picture.image.shape[:2])
            draw_dots_by_level(picture.image, top, colours, shape, picture.theme.background)
    if model.cursor is not None:
        picture.pose("cursor", np.asarray(data.truth)[model.cursor], None)


def compare_key(data: CompareInput) -> tuple[object, ...]:
    """Everything that the picture depends on, except its frame and theme."""
    return (replace(data, mark=None),)
