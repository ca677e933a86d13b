"""The background of a map: floor plan, heat, the part of the floor that was seen, rooms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len

from s2rstore.errors import RequestError
from s2rstore.files.image_header import floor_plan_bytes
from s2rstore.records import Bounds, Room
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame, sample
from s2rtui.canvas import Canvas, Pixels, Theme, legible, luma, mix, turbo
from s2rtui.canvas.raster import draw_braille, draw_half_blocks, draw_shades, line_dots
from s2rtui.canvas.raster import flatten_half_blocks as prepare
from s2rtui.charts.shared.axis_scale import Floats, Interval, percentile_range, scale_fraction

FLOOR_RAMPS = {True: "  ..::", False: "   ░░"}
HEAT_RAMPS = {True: "-=+*#%", False: "▒▓█"}
FAINT = 0.15
"""Share of the heat's range below which no glyphs are drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class MapBackground:
    """The layers below the points of a map.

    floor_plan: (H, W, 3) uint8 over `bounds`, its first row drawn at the top. heat and clip:
    (rows, cols) over `bounds`, row 0 at bounds.y0. heat is NaN where there is none. The floor is
    dimmed where clip is False, 0 or NaN: no selected instance has seen it.
    """

    bounds: Bounds
    y_down: bool = True
    floor_plan: NDArray[np.uint8] | None = None
    heat: Floats | None = None
    heat_range: Interval | None = None
    clip: Floats | Bools | None = None
    rooms: tuple[Room, ...] = ()


def draw_background(canvas: Canvas, ground: MapBackground, frame: MapFrame) -> None:
    """Draw floor plan and heat in half blocks, or in light and dense glyphs without them.

    Unseen floor is dimmed or left blank. Rooms get dotted outlines.
    """
    if ground.floor_plan is not None or ground.heat is not None:
        if canvas.options.supports_shading:
            draw_half_blocks(canvas, 0, 0, background_layer(ground, frame, canvas.theme))
        else:
            _glyphs(canvas, ground, frame)
    _outlines(canvas, ground.rooms, frame)


def _glyphs(canvas: Canvas, ground: MapBackground, frame: MapFrame) -> None:
    seen = seen_layer(ground, frame)
    hidden = None if seen is None else _paired(seen) < 0.5
    floor = floor_layer(ground, frame)
    if floor is not None:
        floor = _paired(floor)
        bright = luma(floor) if canvas.theme.dark else 1 - luma(floor)
        colours = mix(np.array(canvas.theme.background), np.nan_to_num(floor), 0.6)
        levels = bright if hidden is None else np.where(hidden, np.nan, bright)
        draw_shades(canvas, 0, 0, levels, FLOOR_RAMPS[canvas.options.ascii], colours)
    heat = heat_layer(ground, frame)
    if heat is not None:
        levels = _paired(heat)
        shown = levels > FAINT if hidden is None else (levels > FAINT) & ~hidden
        colours = legible(turbo(levels), canvas.theme)
        draw_shades(
            canvas, 0, 0, np.where(shown, levels, np.nan), HEAT_RAMPS[canvas.options.ascii], colours
        )


def _paired(pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """Average pairs of rows, (2h, w[, C]) to (h, w[, C]), without NaN."""
    pair = pixels[: pixels.shape[0] // 2 * 2].reshape(-1, 2, *pixels.shape[1:])
    good = np.isfinite(pair)
    count = good.sum(axis=1)
    total = np.where(good, pair, 0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _outlines(canvas: Canvas, rooms: Sequence[Room], frame: MapFrame) -> None:
    """Dotted outlines of rooms; in ASCII only their corners."""
    dots = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
    for room in rooms:
        (x0, y0), (x1, y1) = frame.to_cells([[room.x0, room.y0], [room.x1, room.y1]]).tolist()
        corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)]
        if canvas.options.ascii:
            for column, row in corners:
                canvas.put(int(np.floor(column)), int(np.floor(row)), "'", canvas.theme.muted)
            continue
        lines = [(corners[start], corners[end]) for start, end in ((0, 1), (2, 3), (0, 2), (1, 3))]
        dots |= line_dots(lines, canvas.width, canvas.height, every=3)
    draw_braille(canvas, dots, canvas.theme.muted)


def draw_room_names(canvas: Canvas, rooms: Sequence[Room], frame: MapFrame) -> None:
    """Write each room's name once in its middle, where it fits."""
    named: set[str] = set()
    for room in rooms:
        if room.room in named:
            continue
        named.add(room.room)
        name = canvas.options.printable(room.room)
        corners = frame.to_cells([[room.x0, room.y0], [room.x1, room.y1]])
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        if cell_len(name) > x1 - x0 or y1 - y0 < 1:
            continue
        row, column = int((y0 + y1) / 2), int((x0 + x1 - cell_len(name)) / 2)
        if 0 <= row < canvas.height and 0 <= column <= canvas.width - cell_len(name):
            columns = np.arange(column, column + cell_len(name))
            prepare(canvas, columns, np.full_like(columns, row))
            canvas.text(column, row, name, canvas.theme.muted)


@lru_cache(maxsize=4)
def floor_plan_pixels(path: str) -> Pixels:
    """The floor plan (H, W, 3). Raises RequestError where it cannot be decoded."""
    from PIL import Image

    content = floor_plan_bytes(Path(path))
    try:
        with Image.open(BytesIO(content), formats=["PNG"]) as picture:
            return np.asarray(picture.convert("RGB"))
    except (OSError, ValueError, SyntaxError) as error:  # Pillow: damage is any of these
        raise RequestError(f"{path}: the floor plan is damaged ({error})") from error


Layer = NDArray[np.floating]


DIMMED = 0.78
"""Opacity of the page colour over floor that was not seen."""


def heat_scale(ground: MapBackground) -> Interval | None:
    """The heat's range: the fixed one, else 1st (or 0 if none is negative) to 99th percentile."""
    scale = _heat_scale(ground.heat) if ground.heat is not None else None
    return ground.heat_range or scale if scale else None


@cached_by_identity(8)
def _heat_scale(heat: Floats) -> Interval | None:
    if not np.isfinite(heat).any():
        return None
    low, high = percentile_range(heat)
    return (0.0, high) if low >= 0 and high > 0 else (low, high)


def background_layer(ground: MapBackground, frame: MapFrame, theme: Theme) -> Pixels:
    """(height, width, 3), read-only: pale floor plan, heat on it, unseen floor dimmed.

    Cached for the last few frames; arrays must not be changed in place.
    """
    bounds, y_down, scale = ground.bounds, ground.y_down, heat_scale(ground)
    arrays = ground.floor_plan, ground.heat, scale, ground.clip
    return _background_layer((bounds, y_down, *arrays), frame, theme)


@cached_by_identity(8)
def _background_layer(background: tuple[Any, ...], frame: MapFrame, theme: Theme) -> Pixels:
    ground = MapBackground(*background)
    layer = _floor(ground, frame, theme)
    shares = heat_layer(ground, frame)
    if shares is not None:
        opacity = 0.12 + 0.74 * np.nan_to_num(shares) ** 0.7
        layer = mix(layer, turbo(shares), np.where(np.isfinite(shares), opacity, 0.0))
    seen = seen_layer(ground, frame)
    if seen is not None:
        layer = mix(layer, np.array(theme.background), DIMMED * (1 - seen))
    layer.setflags(write=False)
    return layer


def _floor(ground: MapBackground, frame: MapFrame, theme: Theme) -> Pixels:
    base = np.empty((frame.height, frame.width, 3), dtype=np.uint8)
    base[:] = theme.background
    floor = floor_layer(ground, frame)
    if floor is None:
        return base
    seen = np.asarray(np.isfinite(floor).all(axis=-1))
    floor = np.nan_to_num(floor)
    grey = np.repeat((luma(floor) * 255)[..., None], 3, axis=-1)
    share = 0.46 if theme.dark else 0.55
    paled = mix(base, 0.45 * floor + 0.55 * grey, share)
    return np.where(seen[..., None], paled, base).astype(np.uint8)


def floor_layer(ground: MapBackground, frame: MapFrame) -> Layer | None:
    """The floor plan's colours (height, width, 3), NaN outside its bounds."""
    if ground.floor_plan is None or _empty(ground.bounds):
        return None
    return _sampled(ground.floor_plan, ground.bounds, frame, ground.y_down)


def heat_layer(ground: MapBackground, frame: MapFrame) -> Layer | None:
    """The heat as fractions of its range (height, width), NaN where there is none."""
    scale = heat_scale(ground)
    if scale is None or ground.heat is None or _empty(ground.bounds):
        return None
    return scale_fraction(_sampled(ground.heat, ground.bounds, frame, True), scale)


def seen_layer(ground: MapBackground, frame: MapFrame) -> Layer | None:
    """The share of each pixel (height, width) that was seen, 0 .. 1; None without clip."""
    if ground.clip is None or _empty(ground.bounds):
        return None
    return _seen(ground.clip, ground.bounds, frame)


@cached_by_identity(8)
def _seen(clip: Floats | Bools, bounds: Bounds, frame: MapFrame) -> Layer:
    return np.nan_to_num(sample(seen_cells(clip), bounds, frame, True))


def seen_cells(clip: NDArray[np.generic]) -> NDArray[np.float32]:
    """The cells of a clip: 1 where seen, else 0."""
    return (np.nan_to_num(np.asarray(clip, dtype=np.float32)) != 0).astype(np.float32)


_sampled = cached_by_identity(8)(sample)


def _empty(bounds: Bounds) -> bool:
    return bounds.width <= 0 or bounds.height <= 0
