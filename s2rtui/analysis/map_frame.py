"""Frames: windows on a map of metres, as grids of square pixels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rstore.records import Bounds
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

    @property
    def extent(self) -> Bounds:
        """The world rectangle in view."""
        far = self.y0 + (1 if self.y_down else -1) * self.height * self.pitch
        return Bounds(
            self.x0, min(self.y0, far), self.x0 + self.width * self.pitch, max(self.y0, far)
        )

    def to_pixels(self, points: ArrayLike) -> Points:
        """Convert (N, 2) metres to (N, 2) pixel coordinates (column, row) with fractions."""
        world = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        down = (world[:, 1] - self.y0) * (1 if self.y_down else -1)
        return np.stack([(world[:, 0] - self.x0) / self.pitch, down / self.pitch], axis=1)

    def to_cells(self, points: ArrayLike) -> Points:
        """Convert (N, 2) metres to (N, 2) cell coordinates (column, row) with fractions."""
        return self.to_pixels(points) / (1.0, 2.0)

    def to_world(self, column: float, row: float) -> tuple[float, float]:
        """The middle of a cell, metres."""
        down = (2 * row + 1) * self.pitch * (1 if self.y_down else -1)
        return self.x0 + (column + 0.5) * self.pitch, self.y0 + down


def fit_frame(area: Bounds, width: int, height: int, y_down: bool) -> MapFrame:
    """The frame of `width` x `height` pixels that shows all of `area`, centred."""
    width, height = max(1, width), max(1, height)
    spans = max(area.width, 1e-6), max(area.height, 1e-6)
    pitch = max(spans[0] / width, spans[1] / height)
    left = (area.x0 + area.x1) / 2 - width * pitch / 2
    middle = (area.y0 + area.y1) / 2
    top = middle - height * pitch / 2 if y_down else middle + height * pitch / 2
    return MapFrame(left, top, pitch, width, height, y_down)


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


def sample(
    image: ArrayLike,
    bounds: Bounds,
    frame: MapFrame,
    top_is_y0: bool,
    pixels: tuple[int, int] = (2, 1),
) -> Floats:
    """Resample an image that covers `bounds` to `frame`: (rows, columns[, C]) float32.

    `pixels` are the rows and columns that each cell is divided into. Each pixel is the mean of up
    to 16 samples of the area that it covers, without NaN; NaN outside the image. `top_is_y0`:
    whether the image's first row lies at bounds.y0.
    """
    source = np.asarray(image)
    rows, columns = source.shape[:2]
    high, wide = frame.height * pixels[0] // 2, frame.width * pixels[1]
    pitches = 2 * frame.pitch / pixels[0], frame.pitch / pixels[1]
    per_pixel = max(pitches) / max(bounds.width / max(columns, 1), 1e-9)
    fine = int(np.clip(np.ceil(per_pixel / 2), 1, 4))
    across = frame.x0 + (np.arange(wide * fine) + 0.5) / fine * pitches[1]
    sign = 1 if frame.y_down else -1
    down = frame.y0 + sign * (np.arange(high * fine) + 0.5) / fine * pitches[0]
    u = np.floor((across - bounds.x0) / bounds.width * columns).astype(np.int64)
    along = (down - bounds.y0) / bounds.height
    v = np.floor((along if top_is_y0 else 1 - along) * rows).astype(np.int64)
    flat = source.reshape(rows, columns, -1)
    if source.dtype.kind != "f":
        total = _sampled_sums(flat, v, u, fine)
        held = [((at >= 0) & (at < size)).reshape(-1, fine).sum(axis=1) for at, size in
                ((v, rows), (u, columns))]  # fmt: skip
        count = np.multiply.outer(*held)[..., None]
    else:
        good = np.isfinite(flat)
        total = _sampled_sums(np.where(good, flat, 0).astype(np.float32), v, u, fine)
        count = _sampled_sums(good.astype(np.uint8), v, u, fine)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count > 0, total / count.astype(np.float32), np.float32(np.nan))
    return mean.astype(np.float32).reshape(high, wide, *source.shape[2:])


def _sampled_sums(
    source: NDArray[np.generic], v: NDArray[np.int64], u: NDArray[np.int64], fine: int
) -> NDArray[np.float32]:
    """Sums of `fine` x `fine` samples at rows `v` and columns `u` of (H, W, C), 0 outside."""
    kind = np.float32 if source.dtype.kind == "f" else np.uint32
    data: NDArray[np.generic] = source
    for at, axis in ((v, 0), (u, 1)):
        size = source.shape[axis]
        inside = ((at >= 0) & (at < size)).reshape(-1, fine)
        index = np.clip(at, 0, size - 1).reshape(-1, fine)
        shape = (-1, 1, 1) if axis == 0 else (1, -1, 1)
        parts = (
            np.take(data, index[:, step], axis=axis).astype(kind)
            * inside[:, step].astype(kind).reshape(shape)
            for step in range(fine)
        )
        data = sum(parts, start=np.zeros((), dtype=kind))
    return data.astype(np.float32)
