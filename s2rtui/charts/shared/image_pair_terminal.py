"""One instance in cells: images of sim and real with heat, and numbers below."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from rich.cells import cell_len

from s2rtui.analysis.identity_cache import identity_key
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, InlineImage, Pixels, RenderOptions, Size, legible
from s2rtui.canvas.colour import DEPTH_SHADES, depth_tint
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.raster import draw_image, draw_shades, resample
from s2rtui.charts.shared.image_pair_model import (
    HEADINGS,
    InstanceInput,
    InstanceModel,
    SideView,
    instance_model,
    panel_pixels,
)
from s2rtui.drawing.heat_colours import heat_colours, heat_ramp
from s2rtui.drawing.legend import LegendPart, colour_bar, draw_rows, fit_rows

SIGNED_RAMP = "ihgfedcba.123456789"
"""Glyphs of signed heat, from the most negative through 0 to the most positive."""
HEAT_RAMP = ".123456789"


@dataclass(frozen=True, slots=True)
class ImagePanel:
    """The place of an image in cells; `what`: "rgb", "original", "depth" or "heat"."""

    what: str
    side: str
    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class InstanceLayout:
    """Images, rows of colour bars from `bars_y`, the table from `table_y` (or None), the notes."""

    panels: tuple[ImagePanel, ...]
    bars: tuple[tuple[LegendPart, ...], ...]
    bars_y: int
    table_y: int | None
    notes: tuple[str, ...] = ()


def instance_layout(
    data: InstanceInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> InstanceLayout:
    """Lay out images as large as possible, with colour bars and table below."""
    width, height = max(1, size[0]), max(1, size[1])
    model = instance_model(data)
    kinds = _kinds(data, model, options)
    bars = [tuple(row) for row in fit_rows(_bars(data, model, options, width), width)]
    table = 1 + len(model.poses)
    title = 1 if height >= 4 else 0
    plans: tuple[tuple[list[str], list[tuple[LegendPart, ...]], int], ...] = (
        (kinds, bars, table),
        (kinds[:1], bars[:1], table),
        (kinds[:1], [], 0),
    )
    for what, rows, lines in plans:
        space = height - title - len(rows) - lines
        if space >= 4 * len(what) or (lines == 0 and space >= 1):
            break
    else:
        what, rows, lines, space = kinds[:1], [], 0, max(1, height - title)
    images = what, _sides(data), _shape(data), width
    notes = note_lines(data, width, options) if lines else []
    shown = _whole_notes(notes, _note_rows(sum(map(len, notes)), space, images, title))
    panels, used = _arrange(*images, space - len(shown), title)
    table_y = used + len(rows) if lines else None
    return InstanceLayout(panels, tuple(rows), used, table_y, tuple(shown))


_Images = tuple[list[str], list[str], tuple[int, int], int]
"""Kinds and sides of the images, their rows and columns, and the width to show them in."""
_KEPT_AREA = 0.6
"""Share of the area of the images that notes below them leave."""


def _whole_notes(notes: Sequence[Sequence[str]], rows: int) -> list[str]:
    """The lines of the notes that fit into `rows`; one that does not fit is left out."""
    shown: list[str] = []
    for note in notes:
        if len(shown) + len(note) <= rows:
            shown += note
    return shown


def _note_rows(most: int, space: int, images: _Images, top: int) -> int:
    """How many rows of notes fit below images that keep most of their size."""

    def area(rows: int) -> int:
        panels, _ = _arrange(*images, rows, top)
        return panels[0].width * panels[0].height if panels else 0

    least = 4 * len(images[0]) if images[0] else 0
    fitting = (
        count
        for count in range(min(most, space - least), 0, -1)
        if area(space - count) >= _KEPT_AREA * area(space)
    )
    return next(fitting, 0)


def _kinds(data: InstanceInput, model: InstanceModel, options: RenderOptions) -> list[str]:
    kinds = ["rgb"] if data.sim.rgb.size or data.real.rgb.size else []
    if any(side.original is not None for side in (data.sim, data.real)):
        kinds.append("original")
    if model.heat_range is not None and not options.supports_images:
        kinds.append("heat")
    if data.sim.depth is not None or data.real.depth is not None:
        kinds.append("depth")
    return kinds


def _sides(data: InstanceInput) -> list[str]:
    """The sides that are shown: both, except without a pose, where a side may have no image."""
    sides = [name for name, side in (("sim", data.sim), ("real", data.real)) if side.rgb.size]
    return ["sim", "real"] if data.truth is not None or not sides else sides


def _shape(data: InstanceInput) -> tuple[int, int]:
    """Rows and columns of the images."""
    rows, columns = (data.sim if data.sim.rgb.size else data.real).rgb.shape[:2]
    return max(1, rows), max(1, columns)


def _arrange(
    kinds: list[str],
    sides: list[str],
    shape: tuple[int, int],
    width: int,
    space: int,
    top: int,
) -> tuple[tuple[ImagePanel, ...], int]:
    """Arrange images in a column per side or in one row, whichever shows them larger."""
    if not kinds:
        return (), 0
    aspect, count = shape[1] / max(1, shape[0]), len(sides)
    best: tuple[int, int, int] = (0, 0, 0)
    for columns in (count, count * len(kinds)):
        rows = count * len(kinds) // columns
        high = space // rows
        wide = min((width - columns + 1) // columns, int(2 * high * aspect))
        high = min(high, -int(-wide / aspect // 2))
        if wide * high > best[0] * best[1]:
            best = (wide, high, columns)
    wide, high, columns = best
    panels = []
    for index, what in enumerate(kinds if wide and high else []):
        for offset, side in enumerate(sides):
            place = index * count + offset
            half = (width + 1) // 2 if columns == 2 else wide + 1
            x = place % columns * max(wide + 1, min(half, wide + 3))
            panels.append(ImagePanel(what, side, x, top + place // columns * high, wide, high))
    rows = count * len(kinds) // columns if columns else 0
    return tuple(panels), top + rows * high


def draw_instance(
    data: InstanceInput, size: Size, options: RenderOptions = DEFAULT_OPTIONS
) -> Canvas:
    """The view in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    model = instance_model(data)
    layout = instance_layout(data, (canvas.width, canvas.height), options)
    for panel in layout.panels:
        _panel(canvas, panel, data, model)
    _titles(canvas, layout, data)
    draw_rows(canvas, 0, layout.bars_y, layout.bars)
    if layout.table_y is not None:
        _table(canvas, layout.table_y, data, model, layout.notes)
    return canvas


def _panel(canvas: Canvas, panel: ImagePanel, data: InstanceInput, model: InstanceModel) -> None:
    side = data.sim if panel.side == "sim" else data.real
    if panel.what == "heat":
        _heat_glyphs(canvas, panel, side, data, model)
    elif panel.what == "original" and side.original is None:
        text = "not translated"
        canvas.text(panel.x, panel.y + panel.height // 2, text[: panel.width], canvas.theme.muted)
    elif side.rgb.size if panel.what in ("rgb", "original") else side.depth is not None:
        plain = data if canvas.options.supports_images else _without_heat(data)
        pixels = partial(panel_pixels, side, panel.what, model, plain)
        draw_image(canvas, panel.x, panel.y, pixels((2 * panel.height, panel.width)))
        if canvas.options.supports_shading:
            sources = (
                side.rgb,
                side.original,
                side.depth,
                side.heat,
                model.heat_range,
                model.depth_range,
            )
            key = identity_key((panel.what, *sources, data.over, data.signed))
            true_pixels = partial(pixels, shades=DEPTH_SHADES)
            canvas.images.append(_inline_image(panel, side, true_pixels, key))
    else:
        text = "no image" if panel.what == "rgb" else "no depth"
        canvas.text(panel.x, panel.y + panel.height // 2, text, canvas.theme.muted)


def _inline_image(
    panel: ImagePanel, side: SideView, pixels: Callable[[Size], Pixels], key: object
) -> InlineImage:
    image = side.depth if panel.what == "depth" and side.depth is not None else side.rgb
    shape = image.shape[0], image.shape[1]
    return InlineImage(panel.x, panel.y, panel.width, panel.height, shape, pixels, key)


def _without_heat(data: InstanceInput) -> InstanceInput:
    sim, real = (SideView(side.rgb, side.depth) for side in (data.sim, data.real))
    return InstanceInput(data.iid, sim, real)


def _heat_glyphs(
    canvas: Canvas, panel: ImagePanel, side: SideView, data: InstanceInput, model: InstanceModel
) -> None:
    """Draw heat in digits (and letters below zero) where images have no colours."""
    if side.heat is None or model.heat_range is None:
        return
    heat = resample(np.asarray(side.heat, dtype=np.float32), panel.height, panel.width)
    low, high = model.heat_range
    colours, _ = heat_colours(heat, model.heat_range, data.signed)
    ramp = SIGNED_RAMP if data.signed else HEAT_RAMP
    draw_shades(
        canvas, panel.x, panel.y, (heat - low) / (high - low), ramp, legible(colours, canvas.theme)
    )


def _titles(canvas: Canvas, layout: InstanceLayout, data: InstanceInput) -> None:
    for panel in layout.panels:
        side = data.sim if panel.side == "sim" else data.real
        if panel.y != 1:
            if panel.what == "original" and side.original is not None:
                canvas.text(panel.x, panel.y, " original "[: panel.width], canvas.theme.text)
            continue
        glyph, colour = canvas.options.role(panel.side)
        title = side.title or panel.side if panel.what == "rgb" else panel.what
        text = canvas.options.printable(f"{glyph} {title}")
        canvas.text(panel.x, 0, text[: panel.width], colour, bold=True)


def _bars(
    data: InstanceInput, model: InstanceModel, options: RenderOptions, width: int
) -> list[LegendPart]:
    """The colour bars of heat and depth, so short that they fit into one row if they can."""
    for length in (12, 8, 6, 4):
        parts = _bars_of_length(data, model, options, width, length)
        if sum(part.width + 2 for part in parts) - 2 <= width:
            return parts
    return _bars_of_length(data, model, options, width, 12 if width >= 44 else 8)


def _bars_of_length(
    data: InstanceInput, model: InstanceModel, options: RenderOptions, width: int, length: int
) -> list[LegendPart]:
    parts = []
    if model.heat_range is not None:
        ramp = None if options.supports_images else (SIGNED_RAMP if data.signed else HEAT_RAMP)
        name = model.heat_name or "heat"
        heat = name, data.unit, model.heat_range, options, length * 4 // 3, heat_ramp(data.signed)
        parts.append(colour_bar(*heat, ramp, width))
    if model.depth_range is not None:
        shades = options.glyphs.shades[::-1]
        ramp = None if options.supports_images else (shades if options.theme.dark else shades[::-1])
        depth = "depth", "m", model.depth_range, options, length, depth_tint
        parts.append(colour_bar(*depth, ramp, width))
    return parts


def _table(
    canvas: Canvas, y: int, data: InstanceInput, model: InstanceModel, notes: Sequence[str]
) -> None:
    theme = canvas.theme
    longest = max((cell_len(line.label) for line in model.poses), default=0)
    label = max(8, longest + 3) if canvas.width >= 42 else 2
    column = min(8, max(6, (canvas.width - label) // 5))
    canvas.text(0, y, fit_text(f"#{data.iid}", label + column - 4), theme.muted)
    for index, heading in enumerate(HEADINGS if model.poses else ()):
        canvas.text(label + (index + 1) * column, y, heading, theme.muted, align="right")
    for row, line in enumerate(model.poses, start=y + 1):
        glyph, colour = canvas.options.role(line.role)
        canvas.text(0, row, fit_text(f"{glyph} {line.label}", label - 1), colour)
        for index, text in enumerate(line.cells):
            strong = index >= 3
            ink = colour if strong else theme.text
            at = label + (index + 1) * column
            canvas.text(at, row, text, ink, bold=strong, align="right")
    for row, text in enumerate(notes, start=y + 1 + len(model.poses)):
        canvas.text(0, row, text, theme.muted)


def note_lines(data: InstanceInput, width: int, options: RenderOptions) -> list[list[str]]:
    """The lines of each note, wrapped at `width` columns; continued ones are indented."""
    texts = (options.printable(f"{name} {value}") for name, value in data.notes)
    return [textwrap.wrap(text, max(12, width), subsequent_indent="  ") for text in texts]
