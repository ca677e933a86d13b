"""Images and dots in cells: block characters, shades, braille, and resampling."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rtui.canvas.block_symbols import BlockCells, is_block
from s2rtui.canvas.canvas import Canvas
from s2rtui.canvas.colour import Pixels, glyph_ground, luma

Floats = NDArray[np.float32]
Place = tuple[float, float]
"""Column and row in cells, with fractions."""

_DOTS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.int32)


def resample(image: ArrayLike, height: int, width: int) -> Floats:
    """Resample (H, W[, C]) to (height, width[, C]) float32 by area averaging.

    NaN is left out of the mean; a pixel that covers only NaN is NaN. Where the target is finer
    than the source, the nearest source pixel is taken.
    """
    source = np.asarray(image)
    if source.shape[0] == 0 or source.shape[1] == 0:
        raise ValueError("resample: the image is empty")
    if source.shape[:2] == (height, width):
        return source.astype(np.float32)
    holes = source.dtype.kind == "f" and bool(np.isnan(source).any())
    if not holes:
        return _area(source, height, width)
    weight = np.isfinite(source).astype(np.float32)
    total = _area(np.nan_to_num(source, nan=0.0), height, width)
    covered = _area(weight, height, width)
    return np.where(covered > 0, total / np.maximum(covered, 1e-9), np.nan).astype(np.float32)


def _area(source: NDArray[np.generic], height: int, width: int) -> Floats:
    data = source
    for axis, target in ((0, height), (1, width)):
        size = data.shape[axis]
        if target >= size:
            index = ((np.arange(target) + 0.5) * size / target).astype(np.intp)
            data = np.take(data, index, axis=axis)
        else:
            edges = np.arange(target + 1) * size // target
            sums = np.add.reduceat(data, edges[:-1], axis=axis, dtype=np.float32)
            shape = [1] * data.ndim
            shape[axis] = target
            data = sums / np.diff(edges).astype(np.float32).reshape(shape)
    return np.asarray(data, dtype=np.float32)


def half_blocks(pixels: Pixels) -> BlockCells:
    """An image (2h, w, 3) as h rows of half blocks."""
    upper, lower = pixels[: len(pixels) // 2 * 2 : 2], pixels[1::2]
    return BlockCells(np.full(upper.shape[:2], "▀"), upper, lower)


def draw_blocks(canvas: Canvas, cells: BlockCells, x: int = 0, y: int = 0) -> None:
    """Draw cells from (x, y), clipped."""
    rows, columns = cells.char.shape
    left, top = max(0, x), max(0, y)
    right, bottom = min(canvas.width, x + columns), min(canvas.height, y + rows)
    if left >= right or top >= bottom:
        return
    part = (slice(top - y, bottom - y), slice(left - x, right - x))
    into = (slice(top, bottom), slice(left, right))
    canvas.char[into] = cells.char[part]
    canvas.bold[into] = False
    canvas.fg[into] = cells.fg[part]
    canvas.bg[into] = cells.bg[part]


def limit_ground(canvas: Canvas) -> None:
    """Give every glyph a ground that it stands out from.

    Cells of images, which are block characters and blanks, stay as they are.
    """
    glyphs = ~is_block(canvas.char) & (canvas.char != " ") & (canvas.char != "")
    colours = canvas.bg[glyphs], canvas.fg[glyphs]
    canvas.bg[glyphs] = glyph_ground(*colours, canvas.theme, canvas.options.mode)


def draw_shades(
    canvas: Canvas, levels: ArrayLike, ramp: str, colours: Pixels | None = None
) -> None:
    """Draw numbers 0 .. 1 (h, w) as glyphs of a ramp, light to dense; NaN draws nothing."""
    values = np.asarray(levels, dtype=np.float32)[: canvas.height, : canvas.width]
    into = (slice(0, values.shape[0]), slice(0, values.shape[1]))
    shown = np.isfinite(values)
    index = np.clip(np.nan_to_num(values) * len(ramp), 0, len(ramp) - 1).astype(np.intp)
    canvas.char[into] = np.where(shown, np.array(list(ramp))[index], canvas.char[into])
    if colours is not None:
        canvas.fg[into] = np.where(shown[..., None], colours[into], canvas.fg[into])


def draw_image(canvas: Canvas, pixels: Pixels) -> None:
    """Draw an image (2h, w, 3) as half blocks, or as shades where half blocks are missing.

    On a light theme the shades are inverted, so that dense glyphs are dark.
    """
    if canvas.options.supports_images:
        draw_blocks(canvas, half_blocks(pixels))
        return
    paired = pixels[: pixels.shape[0] // 2 * 2].reshape(-1, 2, pixels.shape[1], 3).mean(axis=1)
    levels = luma(paired)
    if not canvas.theme.dark:
        levels = 1 - levels
    draw_shades(canvas, levels, canvas.glyphs.shades, np.rint(paired).astype(np.uint8))


def put_glyphs(
    canvas: Canvas, columns: NDArray[np.intp], rows: NDArray[np.intp], glyphs: ArrayLike,
    colours: ArrayLike, bold: ArrayLike = True,
) -> None:  # fmt: skip
    """Put a glyph into each of some cells (n,); glyphs, colours and weights for all or for each."""
    canvas.char[rows, columns] = glyphs
    canvas.bold[rows, columns] = bold
    canvas.fg[rows, columns] = colours


def braille_bits(dots: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Convert dots (4h, 2w) to braille patterns (h, w), 0 .. 255."""
    rows, columns = dots.shape[0] // 4, dots.shape[1] // 2
    cells = dots[: rows * 4, : columns * 2].reshape(rows, 4, columns, 2)
    bits = (cells * _DOTS[None, :, None, :]).sum(axis=(1, 3))
    return np.asarray(bits, dtype=np.int32)


def cells_with_dots(dots: NDArray[np.bool_], fine: int = 4) -> NDArray[np.bool_]:
    """The cells (h, w) that contain any of the dots (fine h, 2w)."""
    rows, columns = dots.shape
    return np.asarray(dots.reshape(rows // fine, fine, columns // 2, 2).any(axis=(1, 3)))


def dot_grid(
    columns: NDArray[np.float64], rows: NDArray[np.float64], width: int, height: int
) -> NDArray[np.bool_]:
    """Rasterise points in fractional cell coordinates to braille dots (4 height, 2 width)."""
    dots = np.zeros((4 * height, 2 * width), dtype=np.bool_)
    across, down = np.floor(columns * 2), np.floor(rows * 4)
    inside = (across >= 0) & (across < 2 * width) & (down >= 0) & (down < 4 * height)
    dots[down[inside].astype(np.intp), across[inside].astype(np.intp)] = True
    return dots


def draw_braille(canvas: Canvas, dots: NDArray[np.bool_], fg: ArrayLike) -> None:
    """Draw dots (4 rows, 2 columns per cell) in one colour, or in one per cell (h, w, 3).

    Dots outside the canvas are clipped.
    """
    bits = braille_bits(dots)[: canvas.height, : canvas.width]
    rows, columns = np.nonzero(bits)
    canvas.char[rows, columns] = (0x2800 + bits[rows, columns]).astype(np.uint32).view("<U1")
    colours = np.asarray(fg, dtype=np.uint8)
    canvas.fg[rows, columns] = colours if colours.ndim == 1 else colours[rows, columns]


def segment_dots(
    lines: Iterable[tuple[Place, Place]], width: int, height: int, every: int = 1
) -> NDArray[np.bool_]:
    """Rasterise lines between cell coordinates to braille dots (4 height, 2 width).

    Only each `every`-th point is drawn.
    """
    dots = np.zeros((4 * height, 2 * width), dtype=np.bool_)
    for (x0, y0), (x1, y1) in lines:
        count = int(min(4096, max(abs(x1 - x0) * 2, abs(y1 - y0) * 4))) + 1
        along = np.linspace(0.0, 1.0, count + 1)[::every]
        dots |= dot_grid(x0 + (x1 - x0) * along, y0 + (y1 - y0) * along, width, height)
    return dots
