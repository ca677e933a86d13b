"""Frames: windows on a map of metres, as grids of square pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas.raster import Floats

Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MapFrame:
    """A window on the map: `width` x `height` square pixels of `pitch` metres.

    (x0, y0) is the world at the top left corner; y grows downwards on the screen if `y_down`.
    In cells a pixel is one column wide and half a row high.
    """

    x0: float
    y0: float
    pitch: float
    width: int
    height: int
    y_down: bool

    def to_pixels(self, points: ArrayLike) -> Points:
        """Convert (N, 2) metres to (N, 2) pixel coordinates (column, row) with fractions."""
        world = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        down = (world[:, 1] - self.y0) * (1 if self.y_down else -1)
        return np.stack([(world[:, 0] - self.x0) / self.pitch, down / self.pitch], axis=1)

    def to_cells(self, points: ArrayLike) -> Points:
        """Convert (N, 2) metres to (N, 2) cell coordinates (column, row) with fractions."""
        return self.to_pixels(points) / (1.0, 2.0)


def zoomed(view: Bounds, factor: float, centre: tuple[float, float] | None = None) -> Bounds:
    """A viewport enlarged `factor` times about `centre` (default: its middle)."""
    x, y = centre or ((view.x0 + view.x1) / 2, (view.y0 + view.y1) / 2)
    return Bounds(
        x + (view.x0 - x) / factor,
        y + (view.y0 - y) / factor,
        x + (view.x1 - x) / factor,
        y + (view.y1 - y) / factor,
    )


def panned(view: Bounds, across: float, down: float, y_down: bool) -> Bounds:
    """A viewport moved by fractions of its size, in directions of the screen."""
    dx, dy = across * view.width, down * view.height * (1 if y_down else -1)
    return Bounds(view.x0 + dx, view.y0 + dy, view.x1 + dx, view.y1 + dy)


def centred_within(view: Bounds, area: Bounds) -> Bounds:
    """A viewport moved so that its centre lies in `area`."""
    x, y = (view.x0 + view.x1) / 2, (view.y0 + view.y1) / 2
    dx = min(max(x, area.x0), area.x1) - x
    dy = min(max(y, area.y0), area.y1) - y
    return Bounds(view.x0 + dx, view.y0 + dy, view.x1 + dx, view.y1 + dy)


_BLOCKS = 4
"""Blocks of an image along each side of a pixel, at least, whose sums are reused."""


def sample(
    image: ArrayLike,
    bounds: Bounds,
    frame: MapFrame,
    top_is_y0: bool,
    pixels: tuple[int, int] = (2, 1),
) -> Floats:
    """Resample an image that covers `bounds` to `frame`: (rows, columns[, C]) float32.

    `pixels` are the rows and columns of each cell. Each pixel is the mean over the area that it
    covers, without NaN; NaN outside the image. Where a pixel covers many of an image of integers,
    its edges are interpolated within blocks of less than a quarter of it; such an image must not be
    changed in place. `top_is_y0`: whether the image's first row lies at bounds.y0.
    """
    source = np.asarray(image)
    rows, columns = source.shape[:2]
    high, wide = frame.height * pixels[0] // 2, frame.width * pixels[1]
    across = frame.x0 + np.arange(wide + 1) / pixels[1] * frame.pitch
    sign = 1 if frame.y_down else -1
    down = frame.y0 + sign * np.arange(high + 1) * 2 / pixels[0] * frame.pitch
    u = (across - bounds.x0) / bounds.width * columns
    along = (down - bounds.y0) / bounds.height
    v = (along if top_is_y0 else 1 - along) * rows
    flipped = bool(v[0] > v[-1])
    edges = np.clip(v[::-1] if flipped else v, 0, rows), np.clip(u, 0, columns)
    if source.dtype.kind == "f":
        flat = source.reshape(rows, columns, -1)
        known = np.isfinite(flat)
        total = _area_sums(np.where(known, flat, 0), *edges)
        covered = _area_sums(known, *edges)
    else:
        steps = [max(1, int(abs(at[1] - at[0]) / _BLOCKS)) for at in (v, u)]
        blocks = _block_sums(source, steps[0], steps[1])
        places = (
            _in_blocks(at, step, size)
            for at, step, size in zip(edges, steps, (rows, columns), strict=True)
        )
        total = _area_sums(blocks, *places)
        covered = np.multiply.outer(*map(np.diff, edges))[..., None]
    mean = np.where(covered > 0, total / np.where(covered > 0, covered, 1), np.nan)
    mean = (mean[::-1] if flipped else mean).astype(np.float32)
    return mean.reshape(high, wide, *source.shape[2:])


@cached_by_identity(8)
def _block_sums(
    image: NDArray[np.generic], rows: int, columns: int
) -> NDArray[np.unsignedinteger[Any]]:
    """(n, m, C): sums of the blocks of `rows` x `columns` pixels of an image (H, W[, C])."""
    flat = image.reshape(*image.shape[:2], -1)
    starts = np.arange(0, flat.shape[0], rows), np.arange(0, flat.shape[1], columns)
    sums = np.add.reduceat(flat, starts[0], axis=0, dtype=np.uint32)
    return np.add.reduceat(sums, starts[1], axis=1)


def _in_blocks(edges: NDArray[np.float64], step: int, size: int) -> NDArray[np.float64]:
    """Places 0 .. size in units of blocks of `step` pixels, the last of which may be smaller."""
    block = np.minimum(np.floor(edges / step), (size - 1) // step)
    length = np.minimum(step, size - block * step)
    return np.asarray(block + (edges - block * step) / length)


def _area_sums(
    image: NDArray[np.generic], rows: NDArray[np.float64], columns: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(n, m, C): integrals of an image (H, W, C) between ascending edges (n + 1,) and (m + 1,)."""
    return _interval_sums(_interval_sums(image, rows, 0), columns, 1)


def _interval_sums(
    values: NDArray[np.generic], edges: NDArray[np.float64], axis: int
) -> NDArray[np.float64]:
    """Integrals of an image (H, W, C) along an axis, between ascending edges (n + 1,).

    Each pixel is one long.
    """
    size, low = values.shape[axis], np.floor(edges).astype(np.intp)
    shape = [1, 1, 1]
    shape[axis] = -1
    part = (edges - low).reshape(shape)
    ends = np.take(values, np.minimum(low, size - 1), axis=axis) * part
    sums = np.diff(ends, axis=axis)
    held = int((low[:-1] < low[-1]).sum())
    if held:
        kind = np.float64 if values.dtype.kind == "f" else np.uint32
        whole, into = [slice(None)] * 3, [slice(None)] * 3
        whole[axis], into[axis] = slice(0, int(low[-1])), slice(0, held)
        inside = np.add.reduceat(values[tuple(whole)], low[:held], axis=axis, dtype=kind)
        inside = inside * (low[1 : held + 1] > low[:held]).reshape(shape)
        sums[tuple(into)] += inside
    return np.asarray(sums, dtype=np.float64)
