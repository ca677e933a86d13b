"""Arrange images in character cells, and draw them in half blocks, shades or digits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import Any

import numpy as np

from s2rtui.analysis.identity_cache import identity_key
from s2rtui.canvas import Canvas, InlineImage, RenderOptions, legible
from s2rtui.canvas.colour import DEPTH_SHADES
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.raster import draw_image as draw_pixels
from s2rtui.canvas.raster import draw_shades, resample
from s2rtui.drawing.heat_colours import heat_colours, ramp_glyphs
from s2rtui.drawing.image import Image, ImageValues
from s2rtui.drawing.plot import Plot

Box = tuple[int, int, int, int]
"""Column, row, width and height in cells."""
_WIDEST_GAP = 3
"""Columns between images beside each other at most."""


def image_rows(plots: Sequence[Plot]) -> list[list[Plot]]:
    """Plots of images in rows, those with the same name of y beside each other."""
    return [list(row) for _, row in groupby(plots, lambda plot: plot.y.names)]


def visible_rows(plots: Sequence[Plot], options: RenderOptions) -> list[list[Plot]]:
    """The rows of images; where these have no colours, values over them have rows of their own."""
    rows = image_rows(plots)
    if options.supports_images:
        return rows
    visible: list[list[Plot]] = []
    apart: set[int] = set()
    for row in rows:
        overlays = [plot.image.overlay if plot.image is not None else None for plot in row]
        visible.append([_with_image(plot, overlay=None) for plot in row])
        found = {id(each.values) for each in overlays if each is not None}
        if not found <= apart:
            visible.append([_overlay_alone(*each) for each in zip(row, overlays, strict=True)])
            apart |= found
    return visible


def _with_image(plot: Plot, **fields: Any) -> Plot:
    """The plot with other fields of its image."""
    marks = (replace(mark, **fields) if isinstance(mark, Image) else mark for mark in plot.marks)
    return replace(plot, marks=tuple(marks))


def _overlay_alone(plot: Plot, values: ImageValues | None) -> Plot:
    """The plot of the values over an image without the image."""
    title = tuple(replace(phrase, text=values.name if values else "") for phrase in plot.title[:1])
    return replace(_with_image(plot, ground=None, missing="", label=""), title=title)


def arrange_images(
    rows: Sequence[Sequence[Plot]], width: int, height: int, thumbnails: bool = False
) -> list[Box]:
    """The boxes of all images in a grid or in one row, whichever shows them larger.

    thumbnails: whether any number may be beside each other, each below a row for its title.

    They have the shape of the first image, in cells that are twice as high as wide. None has a box
    where there is no room.
    """
    if not rows:
        return []
    across, total = len(rows[0]), sum(map(len, rows))
    x, y = rows[0][0].x, rows[0][0].y
    aspect = abs(x.high - x.low) / max(1e-9, abs(y.high - y.low))
    head = int(thumbnails)
    wide, high, columns = 0, 0, across
    for count in range(1, total + 1) if thumbnails else (across, total):
        rows_high = height // -(-total // count) - head
        w = min((width - count + 1) // count, int(2 * rows_high * aspect))
        h = min(rows_high, -int(-w / aspect // 2))
        if w * h > wide * high:
            wide, high, columns = w, h, count
    if not (wide and high):
        return []
    half = (width + 1) // 2 if columns == 2 else 0
    step = max(wide + 1, min(half, wide + _WIDEST_GAP))
    return [(at % columns * step, head + at // columns * (head + high), wide, high)
            for at in range(total)]  # fmt: skip


def draw_image(canvas: Canvas, image: Image) -> None:
    """Draw an image on the whole canvas."""
    if image.ground is not None:
        _draw_ground(canvas, image)
    elif image.overlay is not None and not canvas.options.supports_images:
        _draw_digits(canvas, image.overlay)
    else:
        text = fit_text(image.missing, canvas.width)
        canvas.text(0, canvas.height // 2, text, canvas.theme.muted)
    if image.label:
        before = canvas.char.copy()
        canvas.text(0, 0, fit_text(f" {image.label} ", canvas.width), canvas.theme.text)
        canvas.show_text(canvas.char != before)


def _draw_ground(canvas: Canvas, image: Image) -> None:
    draw_pixels(canvas, image.pixels((2 * canvas.height, canvas.width)))
    if canvas.options.supports_shading:
        true_pixels = partial(image.pixels, shades=DEPTH_SHADES)
        key = identity_key((image.ground, image.overlay, image.marked))
        canvas.images.append(
            InlineImage(0, 0, canvas.width, canvas.height, image.shape, true_pixels, key)
        )


def _draw_digits(canvas: Canvas, over: ImageValues) -> None:
    """Digits of values, and letters below zero."""
    values = resample(np.asarray(over.values, dtype=np.float32), canvas.height, canvas.width)
    colours, _ = heat_colours(values, over.scale, over.is_signed)
    low, high = over.scale
    ramp = ramp_glyphs(over.ramp, canvas.options) or ""
    draw_shades(canvas, (values - low) / (high - low), ramp, legible(colours, canvas.theme))
