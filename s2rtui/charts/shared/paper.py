"""Figures on paper: the page, fonts and colours, headings, colour bars, reproducible files.

Matplotlib is imported when the first figure is drawn.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from s2rstore.errors import RequestError
from s2rtui.canvas import LIGHT, Rgb, Theme
from s2rtui.charts.shared.axis_scale import tick_values

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FileFormat = Literal["png", "svg", "pdf"]
Pixels = tuple[int, int]
Box = tuple[float, float, float, float]
SMALLEST_DPI = 72.0
LETTER = 0.56 / 72
"""Average width of a letter in inches per point of font size."""
EMPTY_METADATA: dict[FileFormat, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
"""Metadata that each file format would contain by default, removed."""
_SETTINGS = {
    "font.family": "DejaVu Sans", "savefig.bbox": None, "path.simplify": True,
    "svg.hashsalt": "s2r", "svg.fonttype": "path", "pdf.fonttype": 42,
}  # fmt: skip
_form: ContextVar[FileFormat] = ContextVar("form", default="png")
_type_size: ContextVar[float] = ContextVar("type_size", default=1.0)


@contextmanager
def figure_format(form: FileFormat = "png", type_size: float = 1.0) -> Iterator[None]:
    """Inside this context figures are written as `form`, fonts and lines enlarged."""
    before = _form.set(form), _type_size.set(type_size)
    try:
        yield
    finally:
        _form.reset(before[0])
        _type_size.reset(before[1])


@dataclass(frozen=True, slots=True)
class Page:
    """The size of a figure in pixels, and its theme.

    Fonts scale with the page: 10 points are 22 pixels on 1600 x 1200, times `type_size`.
    """

    width: int
    height: int
    theme: Theme = LIGHT
    type_size: float = 1.0

    @property
    def dpi(self) -> float:
        usual = math.sqrt(self.width * self.height * 4 / 3) / 10
        return max(SMALLEST_DPI, usual * self.type_size)

    @property
    def inches(self) -> tuple[float, float]:
        return self.width / self.dpi, self.height / self.dpi

    def box(self, left: float, bottom: float, width: float, height: float) -> Box:
        """Convert a rectangle in inches to fractions of the page, never empty."""
        wide, high = self.inches
        return left / wide, bottom / high, max(width / wide, 1e-3), max(height / high, 1e-3)


def make_page(size: Pixels, theme: Theme) -> Page:
    """A page of `size` pixels. Raises RequestError outside 16 .. 20000 pixels a side."""
    width, height = size
    if not (16 <= width <= 20000 and 16 <= height <= 20000):
        raise RequestError(f"--size {width}x{height}: a figure has 16 to 20000 pixels a side")
    return Page(int(width), int(height), theme, _type_size.get())


def new_figure(page: Page) -> Figure:
    """An empty figure on the Agg backend, without pyplot.

    Mathematical text is off, since names may contain dollar signs.
    """
    from matplotlib import rcParams
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rcParams["text.parse_math"] = False
    figure = Figure(
        figsize=page.inches, dpi=page.dpi, facecolor=rgb_fractions(page.theme.background)
    )
    FigureCanvasAgg(figure)
    return figure


def figure_bytes(figure: Figure, page: Page) -> bytes:
    """Encode a figure in exactly the page's size, without date and version."""
    from matplotlib import rc_context

    form = _form.get()
    figure.set_size_inches((page.width + 0.01) / page.dpi, (page.height + 0.01) / page.dpi)
    stream = BytesIO()
    with rc_context(_SETTINGS):
        figure.savefig(stream, format=form, dpi=page.dpi, metadata=EMPTY_METADATA[form])
    return stream.getvalue()


def rgb_fractions(colour: Rgb) -> tuple[float, float, float]:
    """Convert uint8 RGB to matplotlib's 0 .. 1."""
    return colour[0] / 255, colour[1] / 255, colour[2] / 255


def style_axes(axes: Axes, theme: Theme, grid: bool = False) -> None:
    """Style spines, ticks and labels in the theme's colours."""
    axes.set_facecolor(rgb_fractions(theme.background))
    for side, spine in axes.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(rgb_fractions(theme.faint))
        spine.set_linewidth(0.8)
    axes.tick_params(colors=rgb_fractions(theme.muted), labelsize=8, width=0.8, length=3)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_color(rgb_fractions(theme.muted))
        label.set_fontsize(9)
    if grid:
        axes.grid(True, axis="x", color=rgb_fractions(theme.faint), linewidth=0.6)
        axes.set_axisbelow(True)


def draw_heading(figure: Figure, page: Page, title: str, subtitle: str = "") -> float:
    """Write title and subtitle at the upper left; returns the height left below, in inches.

    The title is wrapped to at most two lines, the subtitle to three; the rest is cut.
    """
    y = page.inches[1] - 0.2
    for text, size, weight, colour, drop, most in (
        (title, 13, "bold", page.theme.text, 0.29, 2),
        (subtitle, 9, "normal", page.theme.muted, 0.2, 3),
    ):
        room = max(12, int((page.inches[0] - 0.45) / (size * LETTER)))
        for line in textwrap.wrap(text, room, max_lines=most, placeholder=" …"):
            x, top = 0.25 / page.inches[0], y / page.inches[1]
            label = figure.text(x, top, line, ha="left", va="top", fontsize=size)
            label.set_fontweight(weight)
            label.set_color(rgb_fractions(colour))
            y -= drop
    return max(0.2, y - 0.1)


def wrapped_label(label: str) -> str:
    """Wrap the label of a scale to the width beside a map."""
    return "\n".join(textwrap.wrap(label, 23, break_long_words=False)) or label


def draw_colour_bar(
    figure: Figure, page: Page, box: Box, scale: tuple[float, float], label: str, colours: Any
) -> None:
    """Draw a vertical colour bar with its label above and its ticks at the right."""
    axes = figure.add_axes(box)
    ramp = np.linspace(0, 1, 256)[:, None]
    axes.imshow(
        colours(ramp), aspect="auto", origin="lower", extent=(0, 1, *scale), interpolation="none"
    )
    axes.set_xticks([])
    axes.yaxis.tick_right()
    axes.set_yticks(tick_values(*scale, max(2, int(box[3] * page.inches[1] / 0.27))))
    axes.tick_params(colors=rgb_fractions(page.theme.muted), labelsize=8, width=0.8, length=3)
    for spine in axes.spines.values():
        spine.set_visible(False)
    title = axes.set_title(label, loc="left", fontsize=9, pad=6)
    title.set_color(rgb_fractions(page.theme.text))
