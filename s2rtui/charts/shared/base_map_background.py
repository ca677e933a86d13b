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

from s2rstore.errors import RequestError
from s2rstore.files.image_header import floor_plan_bytes
from s2rstore.records import Bounds, Room
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame, sample
from s2rtui.canvas import Canvas, Pixels, Theme, legible, luma, mix
from s2rtui.canvas.block_symbols import BlockCells, SymbolSet, cells_of, fit_blocks
from s2rtui.canvas.colour import ANSI_16
from s2rtui.canvas.raster import draw_blocks, draw_braille, draw_shades, line_dots
from s2rtui.charts.shared.base_map_floor import (
    draw_walls,
    floor_colours,
    plan_tones,
    wall_pixels,
)
from s2rtui.drawing.heat_colours import heat_glyphs, heat_ramp, heat_strength, map_opacity
from s2rtui.drawing.scale import Floats, Interval, percentile_range, scale_fraction

FLOOR_RAMPS = {True: "  ..::", False: "   ░░"}
WALL_LINES = {True: "_|||_|||_|||_|||", False: "╬║║║═╝╗╣═╚╔╠═╩╦╬"}
"""Walls without block characters, by whether they are ASCII: the character of a cell whose
neighbours above (1), below (2), at the left (4) and at the right (8) are walls, too, at the sum of
these numbers. No other layer of a map has them."""
FAINT = 0.15
"""Share of the heat's range below which no glyphs are drawn."""


@dataclass(frozen=True, slots=True, eq=False)
class MapBackground:
    """The layers below the points of a map.

    floor_plan: (H, W, 3) uint8 over `bounds`, its first row drawn at the top. heat and clip:
    (rows, cols) over `bounds`, row 0 at bounds.y0. heat is NaN where there is none; with
    `heat_is_signed` its colours diverge from 0. The floor is
    dimmed where clip is False, 0 or NaN: no selected instance has seen it.
    """

    bounds: Bounds
    y_down: bool = True
    floor_plan: NDArray[np.uint8] | None = None
    heat: Floats | None = None
    heat_range: Interval | None = None
    heat_is_signed: bool = False
    clip: Floats | Bools | None = None
    rooms: tuple[Room, ...] = ()


def draw_background(canvas: Canvas, ground: MapBackground, frame: MapFrame) -> None:
    """Draw floor plan and heat in block characters, or in light and dense glyphs without them.

    Unseen floor is dimmed or left blank. Rooms get dotted outlines beside the walls of the plan.
    """
    walls: Bools = np.zeros(canvas.char.shape, dtype=np.bool_)
    if ground.floor_plan is not None or ground.heat is not None:
        if canvas.options.supports_shading:
            background = background_cells(ground, frame, canvas.theme, canvas.options.symbol_set)
            draw_blocks(canvas, background.cells)
            walls = background.walls
        else:
            _glyphs(canvas, ground, frame)
            walls = _walls(canvas, ground, frame)
    _outlines(canvas, ground.rooms, frame, walls)


def _glyphs(canvas: Canvas, ground: MapBackground, frame: MapFrame) -> None:
    seen = seen_layer(ground, frame)
    hidden = None if seen is None else _paired(seen) < 0.5
    floor = floor_layer(ground, frame)
    if floor is not None:
        floor = _paired(floor)
        bright = luma(floor) if canvas.theme.dark else 1 - luma(floor)
        colours = mix(np.array(canvas.theme.background), np.nan_to_num(floor), 0.6)
        if canvas.options.supports_images:
            colours[:] = ANSI_16[8 if canvas.theme.dark else 7]
        levels = bright if hidden is None else np.where(hidden, np.nan, bright)
        draw_shades(canvas, 0, 0, levels, FLOOR_RAMPS[canvas.options.ascii], colours)
    heat = heat_layer(ground, frame)
    if heat is not None:
        levels = _paired(heat)
        signed = ground.heat_is_signed
        shown = heat_strength(levels, signed) > FAINT
        shown = shown if hidden is None else shown & ~hidden
        colours = legible(heat_ramp(signed)(levels), canvas.theme)
        ramp = heat_glyphs(canvas.options, signed)
        draw_shades(canvas, 0, 0, np.where(shown, levels, np.nan), ramp, colours)


def _walls(canvas: Canvas, ground: MapBackground, frame: MapFrame) -> Bools:
    """Draw walls in one colour on the page; returns the cells that have one.

    Block characters, or, where colours cannot tell them from heat, lines.
    """
    symbols = canvas.options.symbol_set
    blocks = canvas.options.supports_images
    pixels = (symbols.rows, symbols.columns) if blocks else (1, 1)
    parts = wall_layer(ground, frame, pixels)
    if parts is None:
        return np.zeros(canvas.char.shape, dtype=np.bool_)
    walls, _ = parts
    seen = seen_layer(ground, frame, pixels)
    walls = walls if seen is None else walls & (seen >= 0.5)
    char, held = cells_of(walls, symbols) if blocks else wall_lines(walls, canvas.options.ascii)
    canvas.char[held] = char[held]
    canvas.fg[held] = canvas.theme.wall
    return held


def wall_lines(walls: Bools, ascii: bool) -> tuple[NDArray[np.str_], Bools]:
    """The line characters (h, w) of cells with a wall (h, w), each joined to its neighbours.

    Also returns the cells that have one, which are `walls`.
    """
    near = np.pad(walls, 1)
    up, down = near[:-2, 1:-1], near[2:, 1:-1]
    left, right = near[1:-1, :-2], near[1:-1, 2:]
    joints = up + 2 * down + 4 * left + 8 * right
    return np.array(list(WALL_LINES[ascii]))[joints], walls


def _paired(pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """Average pairs of rows, (2h, w[, C]) to (h, w[, C]), without NaN."""
    pair = pixels[: pixels.shape[0] // 2 * 2].reshape(-1, 2, *pixels.shape[1:])
    good = np.isfinite(pair)
    count = good.sum(axis=1)
    total = np.where(good, pair, 0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _outlines(canvas: Canvas, rooms: Sequence[Room], frame: MapFrame, walls: Bools) -> None:
    """Dotted outlines of rooms, except beside walls; in ASCII only their corners."""
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
    beside = np.pad(walls, 1)
    beside[:, 1:-1] |= beside[:, :-2] | beside[:, 2:]
    beside[1:-1] |= beside[:-2] | beside[2:]
    dots &= ~np.repeat(np.repeat(beside[1:-1, 1:-1], 4, axis=0), 2, axis=1)
    draw_braille(canvas, dots, canvas.theme.muted)


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
PAIR = (2, 1)
"""Rows and columns of pixels in a cell of layers that are drawn as glyphs."""

DIMMED = 0.78
"""Opacity of the page colour over floor that was not seen."""


def heat_scale(ground: MapBackground) -> Interval | None:
    """The heat's range: the fixed one, else up to the 99th percentile of the heat.

    It starts at 0; with signed or negative heat it is symmetric about 0.
    """
    scale = None if ground.heat is None else _heat_scale(ground.heat, ground.heat_is_signed)
    return ground.heat_range or scale if scale else None


@cached_by_identity(8)
def _heat_scale(heat: Floats, signed: bool) -> Interval | None:
    if not np.isfinite(heat).any():
        return None
    low, high = percentile_range(heat)
    if signed or low < 0:
        bound = max(-low, high)
        return -bound, bound
    return (0.0, high) if high > 0 else (low, high)


@dataclass(frozen=True, slots=True, eq=False)
class BackgroundCells:
    """The cells of a background, and which of them (h, w) show a wall."""

    cells: BlockCells
    walls: Bools


def background_cells(
    ground: MapBackground, frame: MapFrame, theme: Theme, symbols: SymbolSet
) -> BackgroundCells:
    """Floor, heat on it and walls, in block characters; unseen floor is dimmed. Read-only.

    Cached for the last few frames; arrays must not be changed in place.
    """
    arrays = (
        ground.floor_plan, ground.heat, heat_scale(ground), ground.heat_is_signed, ground.clip
    )  # fmt: skip
    return _background_cells((ground.bounds, ground.y_down, *arrays), frame, theme, symbols)


@cached_by_identity(8)
def _background_cells(
    background: tuple[Any, ...], frame: MapFrame, theme: Theme, symbols: SymbolSet
) -> BackgroundCells:
    ground, pixels = MapBackground(*background), (symbols.rows, symbols.columns)
    layer = background_pixels(ground, frame, theme, pixels)
    parts = wall_layer(ground, frame, pixels)
    cells = fit_blocks(layer, symbols, theme.background)
    for array in (cells.char, cells.fg, cells.bg):
        array.setflags(write=False)
    held = np.zeros(cells.char.shape, dtype=np.bool_)
    return BackgroundCells(cells, held if parts is None else cells_of(parts[0], symbols)[1])


def background_pixels(
    ground: MapBackground, frame: MapFrame, theme: Theme, pixels: tuple[int, int]
) -> Pixels:
    """(rows, columns, 3): floor, heat on it and walls, for `pixels` (rows, columns) of each cell.

    Unseen floor is dimmed. Cached like `background_cells`, read-only.
    """
    arrays = (
        ground.floor_plan, ground.heat, heat_scale(ground), ground.heat_is_signed, ground.clip
    )  # fmt: skip
    return _background_pixels((ground.bounds, ground.y_down, *arrays), frame, theme, pixels)


@cached_by_identity(4)
def _background_pixels(
    background: tuple[Any, ...], frame: MapFrame, theme: Theme, pixels: tuple[int, int]
) -> Pixels:
    ground = MapBackground(*background)
    layer = _floor(ground, frame, theme, pixels)
    parts = wall_layer(ground, frame, pixels)
    if parts is not None:
        layer[parts[1]] = theme.background
    heated = np.zeros(layer.shape[:2], dtype=np.bool_)
    shares = heat_layer(ground, frame, pixels)
    if shares is not None:
        heated = np.isfinite(shares)
        opacity = map_opacity(shares, ground.heat_is_signed)
        layer = mix(layer, heat_ramp(ground.heat_is_signed)(shares), opacity)
    if parts is not None:
        draw_walls(layer, parts[0], heated, theme)
    seen = seen_layer(ground, frame, pixels)
    if seen is not None:
        layer = mix(layer, np.array(theme.background), DIMMED * (1 - seen))
    layer.setflags(write=False)
    return layer


def _floor(ground: MapBackground, frame: MapFrame, theme: Theme, pixels: tuple[int, int]) -> Pixels:
    floor = floor_layer(ground, frame, pixels)
    if floor is not None and ground.floor_plan is not None:
        return floor_colours(floor, plan_tones(ground.floor_plan, ground.bounds.width), theme)
    base = np.empty((frame.height * pixels[0] // 2, frame.width * pixels[1], 3), dtype=np.uint8)
    base[:] = theme.background
    return base


def wall_layer(
    ground: MapBackground, frame: MapFrame, pixels: tuple[int, int]
) -> tuple[Bools, Bools] | None:
    """Whether each pixel is drawn as wall, and as empty; None without a floor plan."""
    if ground.floor_plan is None or _empty(ground.bounds):
        return None
    return _wall_pixels(ground.floor_plan, ground.bounds, frame, ground.y_down, pixels)


_wall_pixels = cached_by_identity(8)(wall_pixels)


def floor_layer(
    ground: MapBackground, frame: MapFrame, pixels: tuple[int, int] = PAIR
) -> Layer | None:
    """The floor plan's colours (rows, columns, 3), NaN outside its bounds."""
    if ground.floor_plan is None or _empty(ground.bounds):
        return None
    return _sampled(ground.floor_plan, ground.bounds, frame, ground.y_down, pixels)


def heat_layer(
    ground: MapBackground, frame: MapFrame, pixels: tuple[int, int] = PAIR
) -> Layer | None:
    """The heat as fractions of its range (rows, columns), NaN where there is none."""
    scale = heat_scale(ground)
    if scale is None or ground.heat is None or _empty(ground.bounds):
        return None
    return scale_fraction(_sampled(ground.heat, ground.bounds, frame, True, pixels), scale)


def seen_layer(
    ground: MapBackground, frame: MapFrame, pixels: tuple[int, int] = PAIR
) -> Layer | None:
    """The share of each pixel (rows, columns) that was seen, 0 .. 1; None without clip."""
    if ground.clip is None or _empty(ground.bounds):
        return None
    return _seen(ground.clip, ground.bounds, frame, pixels)


@cached_by_identity(8)
def _seen(clip: Floats | Bools, bounds: Bounds, frame: MapFrame, pixels: tuple[int, int]) -> Layer:
    return np.nan_to_num(sample(seen_cells(clip), bounds, frame, True, pixels))


def seen_cells(clip: NDArray[np.generic]) -> NDArray[np.float32]:
    """The cells of a clip: 1 where seen, else 0."""
    return (np.nan_to_num(np.asarray(clip, dtype=np.float32)) != 0).astype(np.float32)


_sampled = cached_by_identity(8)(sample)


def _empty(bounds: Bounds) -> bool:
    return bounds.width <= 0 or bounds.height <= 0
