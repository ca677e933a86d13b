"""Figures on paper: the page, fonts and colours, headings, colour bars, reproducible files.

Matplotlib is imported when the first figure is drawn.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.cells import get_character_cell_size

from s2rstore.errors import RequestError
from s2rtui.canvas import Rgb, Theme
from s2rtui.canvas.colour import NO_DEPTH
from s2rtui.canvas.fit_text import fit_text, wrap_text
from s2rtui.drawing.drawing import ColourBar
from s2rtui.drawing.figure_format import FileFormat, present_format, value_colours
from s2rtui.drawing.heat_colours import ramp_colours
from s2rtui.drawing.scale import (
    Range,
    short_number,
    tick_step,
    tick_text,
    tick_values,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patheffects import AbstractPathEffect

Pixels = tuple[int, int]
Box = tuple[float, float, float, float]
Ink = tuple[float, float, float]
SMALLEST_DPI = 72.0
LETTER = 0.56 / 72
"""Average width of a letter in inches per point of font size."""
BOLD = 1.12
"""Width of bold letters relative to others."""
EMPTY_METADATA: dict[FileFormat, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
"""Metadata that each file format would contain by default, removed."""
_SETTINGS = {
    "font.family": ["DejaVu Sans"], "savefig.bbox": None, "path.simplify": True,
    "svg.hashsalt": "s2r", "svg.fonttype": "path", "pdf.fonttype": 42, "text.parse_math": False,
}  # fmt: skip
"""Matplotlib's settings; names may contain dollar signs, so that mathematical text is off."""
_OTHER_SCRIPTS = ("Noto Sans CJK SC", "Noto Sans CJK JP", "WenQuanYi Zen Hei", "PingFang SC",
                  "Hiragino Sans", "Microsoft YaHei")  # fmt: skip
"""Fonts for letters that the first font lacks, as far as they are installed."""
NARROW = 4.5
"""Pages of fewer inches have smaller headings and margins, and legends below the drawing."""


@contextmanager
def own_settings() -> Iterator[None]:
    """Apply matplotlib's defaults and `_SETTINGS` in this context, not the user's settings.

    The user's settings are restored at the end. As a decorator it covers drawing and saving.
    """
    from matplotlib import rc_context, rcdefaults, rcParams
    from matplotlib.font_manager import fontManager

    with rc_context():
        rcdefaults()
        rcParams.update(_SETTINGS)
        known = {font.name for font in fontManager.ttflist}
        rcParams["font.family"] += [name for name in _OTHER_SCRIPTS if name in known]
        yield


def rgb_fractions(colour: Rgb) -> Ink:
    """Convert uint8 RGB to matplotlib's 0 .. 1."""
    return colour[0] / 255, colour[1] / 255, colour[2] / 255


class Inks:
    """The colours of a theme, by the same names, as matplotlib takes them."""

    def __init__(self, theme: Theme) -> None:
        self._theme = theme

    def __getattr__(self, name: str) -> Ink:
        return rgb_fractions(getattr(self._theme, name))


@dataclass(slots=True, eq=False)
class Page:
    """A figure with a heading; places are in inches from the lower left corner.

    width, height: pixels. inches: (width, height). top: the lower end of the heading.
    """

    figure: Figure
    width: int
    height: int
    theme: Theme
    inks: Inks
    top: float = 0.0

    @property
    def inches(self) -> tuple[float, float]:
        return self.width / self.figure.dpi, self.height / self.figure.dpi

    def axes(
        self, left: float, bottom: float, width: float, height: float, projection: str | None = None
    ) -> Axes:
        """New axes in a rectangle, never empty."""
        wide, high = self.inches
        size = max(width / wide, 1e-3), max(height / high, 1e-3)
        return self.figure.add_axes((left / wide, bottom / high, *size), projection=projection)

    def text(self, x: float, y: float, text: str, ink: Ink, size: float, **style: Any) -> None:
        """Write text at (x, y), by default to the right of it and above it."""
        wide, high = self.inches
        self.figure.text(x / wide, y / high, text, color=ink, fontsize=size, **style)

    def halo(self, width: float) -> list[AbstractPathEffect]:
        """The path effects that set off text from what lies under it; `width` in points."""
        from matplotlib import patheffects

        return [patheffects.withStroke(linewidth=width, foreground=self.inks.background)]

    def encoded(self) -> bytes:
        """The file in exactly the page's size, without date and version, or the pixels."""
        form, dpi = present_format().form, self.figure.dpi
        self.figure.set_size_inches((self.width + 0.01) / dpi, (self.height + 0.01) / dpi)
        if form == "rgb":
            canvas: Any = self.figure.canvas
            canvas.draw()
            return bytes(np.asarray(canvas.buffer_rgba())[: self.height, : self.width, :3])
        stream = BytesIO()
        self.figure.savefig(stream, format=form, dpi=dpi, metadata=EMPTY_METADATA[form])
        return stream.getvalue()


def text_inches(text: str, points: float, weight: str = "normal") -> float:
    """The width of a text in a font of `points`; wide characters are as wide as they are high."""
    from matplotlib.font_manager import FontProperties, fontManager, get_font

    font = get_font(fontManager.findfont(FontProperties(family="DejaVu Sans", weight=weight)))
    font.set_size(100, 72)
    narrow = "".join(letter for letter in text if get_character_cell_size(letter) < 2)
    font.set_text(narrow, 0.0)
    ems = float(font.get_width_height()[0]) / 64 / 100 + len(text) - len(narrow)
    return ems * points / 72


def wrapped_text(
    text: str, inches: float, points: float, weight: str = "normal", most: int | None = None
) -> list[str]:
    """A text in lines of at most `inches`; an ellipsis ends the last one of `most`."""
    letters = max(12, int(inches / (points * LETTER * (BOLD if weight == "bold" else 1.0))))
    lines = _lines(text, letters, most)
    while letters > 12 and any(text_inches(line, points, weight) > inches for line in lines):
        letters -= 1
        lines = _lines(text, letters, most)
    return lines


def _lines(text: str, letters: int, most: int | None) -> list[str]:
    lines = wrap_text(text, letters)
    if most is None or len(lines) <= most:
        return lines
    return [*lines[: most - 1], fit_text(" ".join(lines[most - 1 :]), letters, " …")]


def margin(wide: float) -> float:
    """Inches beside the texts of a page."""
    return 0.15 if wide <= NARROW else 0.25


def page_dpi(size: Pixels) -> float:
    """Pixels per inch of a page of `size` pixels."""
    form, (width, height) = present_format(), size
    scaled = math.sqrt(width * (height or width) * 4 / 3) / 10 * form.type_size
    return form.dpi or max(SMALLEST_DPI, scaled)


def new_page(size: Pixels, theme: Theme, title: str, subtitle: str = "", body: float = 0.0) -> Page:
    """A page of `size` pixels with a heading. Raises RequestError outside 16 .. 20000 pixels.

    A page of height 0 becomes as high as the heading and `body` inches below it.

    The title is wrapped to at most two lines, the subtitle to three; the rest is cut; pages of
    paper (`FigureFormat.dpi`) have up to three and ten lines. Fonts of the other pages scale with
    the page: 10 points are 22 pixels on 1600 x 1200, times the type size. Call it within
    `own_settings`.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    form, (width, height) = present_format(), size
    dpi = page_dpi(size)
    wide = width / dpi
    lines, y = list[tuple[float, str, dict[str, Any]]](), 0.2
    inks = Inks(theme)
    title = title if form.title is None else form.title
    for text, points, weight, ink, most in (
        (title, 13 if wide > NARROW else 10, "bold", inks.text, 3 if form.dpi else 2),
        (subtitle, 9 if wide > NARROW else 8, "normal", inks.muted, 10 if form.dpi else 3),
    ):
        for line in wrapped_text(text, wide - 2 * margin(wide), points, weight, most):
            lines.append((y, line, {"ink": ink, "size": points, "fontweight": weight}))
            y += 1.6 * points / 72
    height = height or round((y + 0.1 + body) * dpi)
    if not (16 <= width <= 20000 and 16 <= height <= 20000):
        raise RequestError(f"--size {width}x{height}: a figure has 16 to 20000 pixels a side")
    high = height / dpi
    figure = Figure(figsize=(wide, high), dpi=dpi, facecolor=inks.background)
    FigureCanvasAgg(figure)
    page = Page(figure, width, height, theme, inks, max(0.2, high - y - 0.1))
    for below, line, style in lines:
        page.text(margin(wide), high - below, line, va="top", **style)
    return page


def style_axes(axes: Axes, page: Page) -> None:
    """Style spines, ticks and labels in the theme's colours."""
    inks = page.inks
    axes.set_facecolor(inks.background)
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(inks.faint)
        spine.set_linewidth(0.8)
    axes.tick_params(colors=inks.muted, labelsize=8, width=0.8, length=3)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set(color=inks.muted, fontsize=9)


def wrapped_label(bar: ColourBar, letters: int) -> str:
    """The label of a colour bar with its unit in parentheses, wrapped."""
    label = f"{bar.label} ({bar.unit or 'no unit'})"
    return "\n".join(textwrap.wrap(label, letters, break_long_words=False)) or label


def colour_bar_ticks(
    scale: Range, height: float, clipped: bool = False
) -> tuple[list[float], list[str]]:
    """Ticks of a colour bar of `height` inches with their labels: both ends, and round numbers
    that keep their distance.

    clipped: whether values beyond the ends have the colours of the ends, which the labels say.
    """
    low, high = scale
    count = max(2, int(height / 0.27))
    width = tick_step(high - low, count)
    apart = 0.2 / max(height, 0.2) * (high - low)
    inner = [at for at in tick_values(low, high, count) if low + apart <= at <= high - apart]
    small = 0.005 * max(abs(low), abs(high))
    ends = [short_number(0.0 if abs(end) < small else end) for end in scale]
    texts = [tick_text(at, width) if 1e-4 <= width < 1e6 else short_number(at) for at in inner]
    labels = [text.replace("-", "−") for text in (ends[0], *texts, ends[1])]
    if clipped:
        labels[0], labels[-1] = f"≤ {labels[0]}", f"≥ {labels[-1]}"
    return [low, *inner, high], labels


def draw_colour_bar(page: Page, box: Box, bar: ColourBar, label: str) -> None:
    """Draw a colour bar in a box (left, bottom, width, height), inches, with `colour_bar_ticks`.

    An upright bar has its label above and its ticks at the right, the other both below. The bar of
    depth is followed by the colour of unknown depth.
    """
    left, bottom, width, height = box
    axes, (low, high) = page.axes(*box), bar.scale
    colours = ramp_colours(bar.ramp, value_colours)(np.linspace(0, 1, 256))
    style: dict[str, Any] = {"aspect": "auto", "origin": "lower", "interpolation": "none"}
    axes.tick_params(colors=page.inks.muted, labelsize=8, width=0.8, length=3)
    for spine in axes.spines.values():
        spine.set_visible(False)
    is_upright = height > width
    if is_upright:
        axes.imshow(colours[:, None], extent=(0, 1, low, high), **style)
        axes.set_xticks([])
        axes.yaxis.tick_right()
        axes.set_yticks(*colour_bar_ticks(bar.scale, height, bar.clipped))
        axes.set_title(label, loc="left", fontsize=9, pad=8, color=page.inks.text)
    else:
        axes.imshow(colours[None], extent=(low, high, 0, 1), **style)
        axes.set_yticks([])
        axes.set_xticks(*colour_bar_ticks(bar.scale, width / 2.5, bar.clipped))
        axes.set_xlabel(label, fontsize=8, color=page.inks.text)
    if bar.ramp == "depth":
        x, y = (
            (left, bottom - 0.3) if is_upright else (left, bottom - 0.6 - 0.14 * label.count("\n"))
        )
        page.text(x, y, "■", rgb_fractions(NO_DEPTH), 9)
        page.text(x + 0.18, y, "no depth", page.inks.muted, 8)
