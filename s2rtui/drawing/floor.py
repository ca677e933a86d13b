"""A floor: plan, heat on it, walls, and what no instance has seen, in pixels and in cells.

Dark themes show dark floor with light walls, light themes light floor with dark walls. The range
of the floor leaves every mark its contrast (see `Theme`). Results are kept for the last few frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.floor_walls import EMPTY, WALL, plan_parts, thin_lines
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.map_frame import MapFrame, sample
from s2rtui.canvas import Canvas, Pixels, Theme, legible, luma, mix
from s2rtui.canvas.block_symbols import BlockCells, SymbolSet, cells_of, fit_blocks
from s2rtui.canvas.colour import ANSI_16, contrast, with_luminance
from s2rtui.canvas.raster import draw_blocks, draw_braille, draw_shades, segment_dots
from s2rtui.drawing.heat_colours import heat_glyphs, heat_ramp, heat_strength, map_opacity
from s2rtui.drawing.plane_marks import Floor, Outlines
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.scale import Floats, Range, Scale, percentile_range, scale_fraction

Layer = NDArray[np.floating]
PAIR = (2, 1)
"""Rows and columns of pixels in a cell of square pixels."""
DIMMED = 0.78
"""Opacity of the page colour over floor that was not seen."""
_SATURATION = {True: 0.65, False: 0.4}
"""Share of the plan's saturation that the floor keeps, on dark and on light themes."""
_SAMPLES = 256
"""Rows and columns of a plan of which its range of brightness is found."""


def plane_frame(x: Scale, y: Scale, width: int, height: int) -> MapFrame:
    """The frame of `width` x `height` cells, each twice as high as wide, of equal scales."""
    return MapFrame(x.low, y.high, (x.high - x.low) / width, width, 2 * height, y.low > y.high)


@cached_by_identity(8)
def floor_heat_scale(heat: Floats, is_signed: bool) -> Range | None:
    """The scale of heat, up to its 99th percentile; None where there is no heat.

    It starts at 0; with signed or negative heat it is symmetric about 0.
    """
    if not np.isfinite(heat).any():
        return None
    low, high = percentile_range(heat)
    if is_signed or low < 0:
        bound = max(-low, high)
        return -bound, bound
    return (0.0, high) if high > 0 else (low, high)


@cached_by_identity(4)
def plan_tones(plan: Pixels, width: float) -> Range:
    """The 5th and 95th percentile of the brightness of a plan's floor, 0 .. 1.

    `width` is that of the plan in metres.
    """
    bright, solid = luma(_thinned(plan)), _thinned(plan_parts(plan, width)).any(axis=-1)
    if solid.all():
        return 0.0, 1.0
    low, high = np.percentile(bright[~solid], (5, 95))
    return float(low), max(float(high), float(low) + 0.05)


def _thinned(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Evenly spaced pixels (_SAMPLES, _SAMPLES, C) of an image."""
    rows, columns = (np.linspace(0, size - 1, _SAMPLES, dtype=int) for size in image.shape[:2])
    return image[rows[:, None], columns]


@cached_by_identity(8)
def floor_pixels(
    floor: Floor, frame: MapFrame, theme: Theme, pixels: tuple[int, int] = PAIR
) -> Pixels:
    """(rows, columns, 3): floor, heat on it and walls, for `pixels` (rows, columns) of each cell.

    Unseen floor is dimmed. Read-only.
    """
    colours = plan_layer(floor, frame, pixels)
    if colours is not None and floor.plan is not None:
        layer = _floor_colours(colours, plan_tones(floor.plan, floor.bounds.width), theme)
    else:
        size = frame.height * pixels[0] // 2, frame.width * pixels[1]
        layer = np.full((*size, 3), theme.background, dtype=np.uint8)
    solid = wall_layer(floor, frame, pixels)
    if solid is not None:
        layer[solid[1]] = theme.background
    heated = np.zeros(layer.shape[:2], dtype=np.bool_)
    shares = heat_layer(floor, frame, pixels)
    if shares is not None:
        heated = np.isfinite(shares)
        opacity = map_opacity(shares, floor.heat_is_signed)
        layer = mix(layer, heat_ramp(floor.heat_is_signed)(shares), opacity)
    if solid is not None:
        _draw_walls(layer, solid[0], heated, theme)
    seen = seen_layer(floor, frame, pixels)
    if seen is not None:
        layer = mix(layer, np.array(theme.background), DIMMED * (1 - seen))
    layer.setflags(write=False)
    return layer


def _floor_colours(colours: Layer, tones: Range, theme: Theme) -> Pixels:
    """Colours of floor (..., 3), 0 .. 255 with NaN outside the plan, which gets the page colour.

    Brightness between `tones` is spread over the luminances of the theme's floor in equal ratios.
    """
    outside = ~np.isfinite(colours).all(axis=-1)
    colours = np.nan_to_num(colours)
    bright = luma(colours)
    share = np.clip((bright - tones[0]) / (tones[1] - tones[0]), 0, 1)
    low, high = theme.floor
    wanted = low * (high / low) ** share
    grey = 255 * bright[..., None]
    pale = np.clip(grey + _SATURATION[theme.dark] * (colours - grey), 0, 255)
    drawn = with_luminance(np.rint(pale).astype(np.uint8), wanted, wanted)
    drawn[outside] = theme.background
    return drawn


def _draw_walls(layer: Pixels, walls: Bools, heated: Bools, theme: Theme) -> None:
    """Colour the walls of a layer (h, w, 3) in place.

    On heat they have the one of text and page colour that contrasts more with it.
    """
    layer[walls & ~heated] = theme.wall
    hot = walls & heated
    below = layer[hot]
    inverse = contrast(below, theme.background) > contrast(below, theme.text)
    layer[hot] = np.where(inverse[:, None], theme.background, theme.text)


def wall_layer(
    floor: Floor, frame: MapFrame, pixels: tuple[int, int] = PAIR
) -> tuple[Bools, Bools] | None:
    """Whether each pixel is drawn as wall, and as empty; None without a floor plan."""
    if floor.plan is None or _is_empty(floor.bounds):
        return None
    return _wall_pixels(floor.plan, floor.bounds, frame, pixels)


@cached_by_identity(8)
def _wall_pixels(
    plan: Pixels, bounds: Bounds, frame: MapFrame, pixels: tuple[int, int]
) -> tuple[Bools, Bools]:
    parts = plan_parts(plan, bounds.width)
    coverage = np.nan_to_num(sample(parts, bounds, frame, frame.y_down, pixels))
    return thin_lines(coverage[..., WALL]), coverage[..., EMPTY] >= 0.5


def plan_layer(floor: Floor, frame: MapFrame, pixels: tuple[int, int] = PAIR) -> Layer | None:
    """The floor plan's colours (rows, columns, 3), NaN outside its bounds."""
    if floor.plan is None or _is_empty(floor.bounds):
        return None
    return _sampled(floor.plan, floor.bounds, frame, frame.y_down, pixels)


def heat_layer(floor: Floor, frame: MapFrame, pixels: tuple[int, int] = PAIR) -> Layer | None:
    """The heat as fractions of its scale (rows, columns), NaN where there is none."""
    if floor.heat is None or _is_empty(floor.bounds):
        return None
    scale = floor_heat_scale(floor.heat, floor.heat_is_signed)
    if scale is None:
        return None
    return scale_fraction(_sampled(floor.heat, floor.bounds, frame, True, pixels), scale)


def seen_layer(floor: Floor, frame: MapFrame, pixels: tuple[int, int] = PAIR) -> Layer | None:
    """The share of each pixel (rows, columns) that was seen, 0 .. 1; None where all was."""
    if floor.seen is None or _is_empty(floor.bounds):
        return None
    return _seen(floor.seen, floor.bounds, frame, pixels)


@cached_by_identity(8)
def _seen(seen: Floats | Bools, bounds: Bounds, frame: MapFrame, pixels: tuple[int, int]) -> Layer:
    cells = (np.nan_to_num(np.asarray(seen, dtype=np.float32)) != 0).astype(np.float32)
    return np.nan_to_num(sample(cells, bounds, frame, True, pixels))


_sampled = cached_by_identity(8)(sample)


def _is_empty(bounds: Bounds) -> bool:
    return bounds.width <= 0 or bounds.height <= 0


FLOOR_RAMPS = {True: "  ..::", False: "   ░░"}
WALL_LINES = {True: "_|||_|||_|||_|||", False: "╬║║║═╝╗╣═╚╔╠═╩╦╬"}
"""Walls without block characters, by whether they are ASCII: the character of a cell whose
neighbours above (1), below (2), at the left (4) and at the right (8) are walls, too, at the sum of
these numbers. No other mark of a map has them."""
_FAINT = 0.15
"""Share of the heat's range below which no glyphs are drawn."""


def draw_floor(canvas: Canvas, plot: Plot, floor: Floor) -> None:
    """Floor plan and heat in block characters, or in light and dense glyphs without them.

    Unseen floor is dimmed or left blank.
    """
    if floor.is_plain:
        return
    frame = plane_frame(plot.x, plot.y, canvas.width, canvas.height)
    if canvas.options.supports_shading:
        draw_blocks(canvas, _block_cells(floor, frame, canvas.theme, canvas.options.symbol_set))
    else:
        _draw_glyphs(canvas, floor, frame)
        _draw_wall_glyphs(canvas, floor, frame)


def draw_outlines(canvas: Canvas, plot: Plot, outlines: Outlines) -> None:
    """Dotted outlines of rooms, except beside walls; in ASCII only their corners."""
    frame = plane_frame(plot.x, plot.y, canvas.width, canvas.height)
    dots = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
    for room in outlines.rooms:
        (x0, y0), (x1, y1) = frame.to_cells([[room.x0, room.y0], [room.x1, room.y1]]).tolist()
        corners = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)]
        if canvas.options.ascii:
            for column, row in corners:
                canvas.put(int(np.floor(column)), int(np.floor(row)), "'", canvas.theme.muted)
            continue
        lines = [(corners[start], corners[end]) for start, end in ((0, 1), (2, 3), (0, 2), (1, 3))]
        dots |= segment_dots(lines, canvas.width, canvas.height, every=3)
    if dots.any():
        dots &= ~np.repeat(np.repeat(_beside_walls(canvas, plot, frame), 4, axis=0), 2, axis=1)
    draw_braille(canvas, dots, canvas.theme.muted)


@cached_by_identity(8)
def _block_cells(floor: Floor, frame: MapFrame, theme: Theme, symbols: SymbolSet) -> BlockCells:
    layer = floor_pixels(floor, frame, theme, (symbols.rows, symbols.columns))
    cells = fit_blocks(layer, symbols, theme.background)
    for array in (cells.char, cells.fg, cells.bg):
        array.setflags(write=False)
    return cells


def _draw_glyphs(canvas: Canvas, floor: Floor, frame: MapFrame) -> None:
    seen = seen_layer(floor, frame)
    hidden = None if seen is None else _paired(seen) < 0.5
    plan = plan_layer(floor, frame)
    if plan is not None:
        plan = _paired(plan)
        bright = luma(plan) if canvas.theme.dark else 1 - luma(plan)
        colours = mix(np.array(canvas.theme.background), np.nan_to_num(plan), 0.6)
        if canvas.options.supports_images:
            colours[:] = ANSI_16[8 if canvas.theme.dark else 7]
        levels = bright if hidden is None else np.where(hidden, np.nan, bright)
        draw_shades(canvas, levels, FLOOR_RAMPS[canvas.options.ascii], colours)
    heat = heat_layer(floor, frame)
    if heat is not None:
        levels = _paired(heat)
        is_signed = floor.heat_is_signed
        shown = heat_strength(levels, is_signed) > _FAINT
        shown = shown if hidden is None else shown & ~hidden
        colours = legible(heat_ramp(is_signed)(levels), canvas.theme)
        ramp = heat_glyphs(canvas.options, is_signed)
        draw_shades(canvas, np.where(shown, levels, np.nan), ramp, colours)


def _paired(pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """Average pairs of rows, (2h, w[, C]) to (h, w[, C]), without NaN."""
    pair = pixels[: pixels.shape[0] // 2 * 2].reshape(-1, 2, *pixels.shape[1:])
    good = np.isfinite(pair)
    count = good.sum(axis=1)
    total = np.where(good, pair, 0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _draw_wall_glyphs(canvas: Canvas, floor: Floor, frame: MapFrame) -> None:
    """Walls in one colour on the page."""
    char, held = _walls(canvas, floor, frame)
    canvas.char[held] = char[held]
    canvas.fg[held] = canvas.theme.wall


def _beside_walls(canvas: Canvas, plot: Plot, frame: MapFrame) -> Bools:
    """The cells (h, w) that show a wall of the plot's floor, and their neighbours."""
    held = np.zeros((canvas.height + 2, canvas.width + 2), dtype=np.bool_)
    for floor in (mark for mark in plot.marks if isinstance(mark, Floor)):
        held[1:-1, 1:-1] |= _walls(canvas, floor, frame)[1]
    held[:, 1:-1] |= held[:, :-2] | held[:, 2:]
    held[1:-1] |= held[:-2] | held[2:]
    return held[1:-1, 1:-1]


def _walls(canvas: Canvas, floor: Floor, frame: MapFrame) -> tuple[NDArray[np.str_], Bools]:
    """The characters (h, w) of walls and the cells that have one.

    Block characters, or lines where colours cannot tell them from heat.
    """
    options, symbols = canvas.options, canvas.options.symbol_set
    pixels = (symbols.rows, symbols.columns) if options.supports_images else (1, 1)
    parts = wall_layer(floor, frame, pixels)
    if parts is None:
        return canvas.char, np.zeros(canvas.char.shape, dtype=np.bool_)
    walls, seen = parts[0], seen_layer(floor, frame, pixels)
    if seen is not None and not options.supports_shading:
        walls = walls & (seen >= 0.5)
    return cells_of(walls, symbols) if options.supports_images else wall_lines(walls, options.ascii)


def wall_lines(walls: Bools, ascii: bool) -> tuple[NDArray[np.str_], Bools]:
    """The line characters (h, w) of cells with a wall (h, w), each joined to its neighbours.

    Also returns the cells that have one, which are `walls`.
    """
    near = np.pad(walls, 1)
    up, down = near[:-2, 1:-1], near[2:, 1:-1]
    left, right = near[1:-1, :-2], near[1:-1, 2:]
    joints = up + 2 * down + 4 * left + 8 * right
    return np.array(list(WALL_LINES[ascii]))[joints], walls
