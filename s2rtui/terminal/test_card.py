"""The test card of `s2r doctor`: samples of every kind of character and colour that views use."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from s2rtui.canvas import DEFAULT_OPTIONS, DIGITS, Canvas, RenderOptions, Size, turbo
from s2rtui.canvas.block_symbols import SYMBOL_SETS, Symbols, symbol_stripes
from s2rtui.canvas.fit_text import wrap_text
from s2rtui.canvas.raster import draw_blocks, draw_braille, half_blocks

Rows = list[tuple[str, str]]
LABEL = 22
_NARROW = 60
"""Below this width a state is written below its name."""


def card_height(rows: Rows, width: int) -> int:
    """The height of a card of `width` columns."""
    lines = sum(max(1, len(_wrapped(state, width))) for _, state in rows)
    narrow = width < _NARROW
    advice = max(len(_wrapped(text, width, 0)) for text in _ADVICE.values())
    return lines + (len(rows) + 2 * len(_SAMPLES) if narrow else len(_SAMPLES)) + 3 + advice


def draw_card(rows: Rows, size: Size, options: RenderOptions = DEFAULT_OPTIONS) -> Canvas:
    """Draw lines of text and samples below them in `size` (columns, rows)."""
    canvas = Canvas(*size, options)
    theme, width = options.theme, canvas.width
    narrow = width < _NARROW
    x, y = (2 if narrow else LABEL), 0
    for name, state in rows:
        canvas.text(0, y, name, theme.muted)
        y += narrow
        for line in _wrapped(state, width) or [""]:
            canvas.text(x, y, options.printable(line), theme.text)
            y += 1
    canvas.text(0, y + 1, "what you should see", theme.text, bold=True)
    y += 2
    for label, draw in _SAMPLES:
        canvas.text(0, y, label, theme.muted)
        y += narrow
        draw(canvas, x, y)
        y += 1
    for row, line in enumerate(_wrapped(_ADVICE[options.ascii], width, 0)):
        canvas.text(0, y + 1 + row, line, theme.muted)
    return canvas


def _wrapped(text: str, width: int, label: int | None = None) -> list[str]:
    """A state wrapped to the room beside its name, or below it."""
    label = (2 if width < _NARROW else LABEL) if label is None else label
    return wrap_text(text, max(8, width - label))


def _roles(canvas: Canvas, x: int, y: int) -> None:
    theme, glyphs = canvas.theme, canvas.glyphs
    for glyph, name, ink in (
        (glyphs.sim, "blue", theme.sim),
        (glyphs.real, "red", theme.real),
        (glyphs.truth, "gold", theme.truth),
    ):
        x = canvas.text(x, y, f"{glyph} {name}  ", ink, bold=True)


def _scale(canvas: Canvas, x: int, y: int) -> None:
    colours = turbo(np.linspace(0, 1, 40))
    for place, colour in enumerate(colours):
        ink = (int(colour[0]), int(colour[1]), int(colour[2]))
        if canvas.options.supports_images:
            canvas.put(x + place, y, " ", bg=ink)
        else:
            canvas.put(x + place, y, DIGITS[place * len(DIGITS) // 40], ink)


def _picture(canvas: Canvas, x: int, y: int) -> None:
    if not canvas.options.supports_images:
        canvas.text(x, y, "shades: " + canvas.glyphs.shades, canvas.theme.text)
        return
    across = np.linspace(0, 1, 40)
    rows = np.stack([turbo(across), turbo(1 - across)])
    draw_blocks(canvas, half_blocks(rows), x, y)


def _dots(canvas: Canvas, x: int, y: int) -> None:
    if canvas.options.ascii:
        canvas.text(x, y, "none: ASCII only", canvas.theme.text)
        return
    places = np.arange(80)
    wave = np.rint(1.5 + 1.5 * np.sin(places / 6)).astype(np.intp)
    dots = np.zeros((4 * canvas.height, 2 * canvas.width), dtype=np.bool_)
    inside = (2 * x + places < dots.shape[1]) & (4 * y + wave < dots.shape[0])
    dots[4 * y + wave[inside], 2 * x + places[inside]] = True
    draw_braille(canvas, dots, canvas.theme.text)


def _symbols(name: Symbols) -> Callable[[Canvas, int, int], None]:
    """Draw slanted stripes of a set of block characters."""

    def draw(canvas: Canvas, x: int, y: int) -> None:
        if canvas.options.ascii:
            canvas.text(x, y, "none: ASCII only", canvas.theme.text)
            return
        for place, char in enumerate(symbol_stripes(SYMBOL_SETS[name], 40)):
            canvas.put(x + place, y, char, canvas.theme.text)

    return draw


def _bars(canvas: Canvas, x: int, y: int) -> None:
    canvas.text(x, y, ".#" if canvas.options.ascii else "▁▂▃▄▅▆▇█" * 4, canvas.theme.sim)


def _lines(canvas: Canvas, x: int, y: int) -> None:
    glyphs = canvas.glyphs
    drawn = f"{' '.join(glyphs.arrows)}  {glyphs.scale_left}{glyphs.horizontal * 6}"
    canvas.text(x, y, f"{drawn}{glyphs.scale_right}  {glyphs.vertical}", canvas.theme.text)


_SAMPLES: tuple[tuple[str, Callable[[Canvas, int, int], None]], ...] = (
    ("sim, real, truth", _roles),
    ("a scale, low to high", _scale),
    ("a picture", _picture),
    ("quadrants: stripes", _symbols("quadrant")),
    ("sextants: stripes", _symbols("sextant")),
    ("octants: stripes", _symbols("octant")),
    ("dots, 8 in a cell", _dots),
    ("bars in eighths", _bars),
    ("arrows and lines", _lines),
)
_ADVICE = {
    True: "boxes or question marks disappear with --ascii; a UTF-8 locale shows more",
    False: "boxes or question marks instead of these: use --ascii; wrong colours: --colour 256; "
    "--symbols sextant or octant draws finer floor plans where their stripes are whole",
}
