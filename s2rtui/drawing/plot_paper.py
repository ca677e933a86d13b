"""Draw the marks of a plot on axes of matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from s2rtui.canvas import Pixels, Theme
from s2rtui.canvas.render_options import UNICODE
from s2rtui.drawing.image import Image
from s2rtui.drawing.page import BOLD, LETTER, NARROW, Ink, Inks, Page, style_axes, value_colours
from s2rtui.drawing.plane_marks import PlaneMark
from s2rtui.drawing.plane_paper import CELLS_PER_INCH, draw_plane_mark
from s2rtui.drawing.plot import Bars, Dots, Line, Plot, Points, Rule, Sign
from s2rtui.drawing.points_paper import draw_points
from s2rtui.drawing.scale import Scale, short_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

_X_TICKS, _Y_TICKS = 0.7, 0.35
"""Inches between ticks at least."""
_LINE = 0.17
"""Height of a label in inches."""
_BESIDE = 0.2
"""Inches beside an axis of x into which its labels may reach."""
_SCREEN_DPI = 110.0
"""Pixels per inch of dials on the screen of a terminal with graphics."""
LEGEND_COLUMNS = 2
MARKERS: dict[Sign, tuple[str, bool]] = {
    "sim": ("D", True), "real": ("D", False), "truth": ("o", True), "both": ("s", True),
    "cursor": ("^", True), "pointer": (">", True), "selected": ("o", True), "trained": ("o", False),
    "baseline": ("|", True), "vertical": ("|", True), "passed": ("o", True), "failed": ("^", True),
    "inconclusive": ("o", False), "skipped": (".", True), "interval": ("_", True),
    "planned": (">", True),
    "below": ("v", True), "above": ("^", True),
}  # fmt: skip
"""The marker of each sign, and whether it is filled."""


def draw_plot(
    axes: Axes, page: Page, plot: Plot, inches: tuple[float, float], has_x: bool, has_y: bool
) -> None:
    """Draw a plot in `inches` (width, height) with the labels of x and the name of y if wanted."""
    font = 8 if page.inches[0] <= NARROW else 9
    width, height = inches
    style_axes(axes, page)
    for spine in axes.spines.values() if plot.is_tight else ():
        spine.set_visible(True)
    draw_marks(axes, page, plot, inches)
    for axis, scale in ((axes.xaxis, plot.x), (axes.yaxis, plot.y)):
        is_x = axis.axis_name == "x"
        axis.set_ticks(*axis_ticks(scale, width if is_x else height, is_x))
        axis.set_ticks([], minor=True)
        if is_x:
            _keep_on_page(axis, scale, width)
    if has_x:
        axes.set_xlabel(axis_name(plot.x, width))
    else:
        axes.tick_params(labelbottom=False)
    if has_y:
        axes.set_ylabel(axis_name(plot.y, height))
    if plot.title:
        name, *others = plot.title
        axes.set_title(name.text, loc="left", fontsize=font + 1, pad=5, fontweight="bold",
                       color=getattr(page.inks, name.ink))  # fmt: skip
        text = "   ".join(phrase.whole(UNICODE) for phrase in others)
        if (BOLD * (font + 1) * len(name.text) + font * (len(text) + 2)) * LETTER > width:
            text = ""
        axes.set_title(text, loc="right", fontsize=font, pad=5, color=page.inks.text)
    elif plot.legend:
        axes.legend(
            loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0, ncols=LEGEND_COLUMNS,
            fontsize=font, frameon=False, labelcolor=page.inks.text,
        )  # fmt: skip


def plot_pixels(plot: Plot, theme: Theme, size: tuple[int, int], columns: int) -> Pixels:
    """The marks of a plot, without axes and texts, in `size` (height, width) pixels.

    columns: cells of the terminal that it is wide.
    """

    def draw(page: Page) -> None:
        axes = page.axes(0.0, 0.0, *page.inches)
        axes.set_axis_off()
        draw_marks(axes, page, plot, page.inches, False)

    return drawn_pixels(theme, size, draw, CELLS_PER_INCH * size[1] / columns)


def drawn_pixels(
    theme: Theme, size: tuple[int, int], draw: Callable[[Page], None], dpi: float = _SCREEN_DPI
) -> Pixels:
    """What `draw` draws on a page without heading, in `size` (height, width) pixels."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    height, width = size
    inches = width / dpi, height / dpi
    inks = Inks(theme)
    figure = Figure(figsize=inches, dpi=dpi, facecolor=inks.background)
    canvas = FigureCanvasAgg(figure)
    draw(Page(figure, width, height, theme, inks))
    canvas.draw()
    return np.array(np.asarray(canvas.buffer_rgba())[:height, :width, :3])


def draw_sign(page: Page, x: float, y: float, sign: Sign, ink: Ink) -> None:
    """Draw the marker of a sign at a place of the page in inches."""
    from matplotlib.lines import Line2D

    (wide, high), (marker, is_filled) = page.inches, MARKERS[sign]
    face = ink if is_filled else page.inks.background
    page.figure.add_artist(Line2D([x / wide], [y / high], color=ink, marker=marker, markersize=5.5,
                                  markerfacecolor=face, linestyle="none"))  # fmt: skip


def _keep_on_page(axis: Axis, scale: Scale, inches: float) -> None:
    """Move the labels that would reach beyond the axis and the room beside it."""
    for label, at in zip(axis.get_ticklabels(), axis.get_ticklocs(), strict=True):
        beyond = len(label.get_text()) * LETTER * 8 / 2 - _BESIDE
        place = float(scale.fraction(at)) * inches
        if place + beyond > inches:
            label.set_horizontalalignment("right")


def draw_marks(
    axes: Axes, page: Page, plot: Plot, inches: tuple[float, float], is_page: bool = True
) -> None:
    """The ends of both scales, and the marks."""
    for name, scale in (("x", plot.x), ("y", plot.y)):
        if scale.log:
            getattr(axes, f"set_{name}scale")("log")
        axes.set(**{f"{name}lim": (scale.low, scale.high)})
    for mark in plot.marks:
        if isinstance(mark, Points):
            draw_points(axes, page, plot, mark, inches)
        elif isinstance(mark, PlaneMark):
            draw_plane_mark(axes, page, plot, mark, inches, is_page)
        elif isinstance(mark, Image):
            _draw_image(axes, page, plot, mark)
        else:
            _draw_mark(axes, page, plot, mark)


def _draw_image(axes: Axes, page: Page, plot: Plot, image: Image) -> None:
    """The pixels of an image, or in its middle why there are none."""
    if image.shape is None:
        axes.text(0.5, 0.5, image.missing, transform=axes.transAxes, ha="center", va="center",
                  color=page.inks.muted)  # fmt: skip
        return
    pixels = image.pixels(image.shape, unsigned_colours=value_colours)
    extent = plot.x.low, plot.x.high, plot.y.low, plot.y.high
    axes.imshow(pixels, interpolation="antialiased", aspect="auto", extent=extent)


def axis_name(scale: Scale, width: float) -> str:
    """The name of an axis that fits into `width` inches."""
    names = scale.names or ("",)
    return scale.name(width, lambda text: LETTER * 9 * len(text)) or names[-1]


def axis_ticks(scale: Scale, inches: float, is_x: bool) -> tuple[list[float], list[str]]:
    """The ticks of an axis and their labels, empty where they would collide."""
    letter = LETTER * 8
    apart, gap = (_X_TICKS, letter) if is_x else (_Y_TICKS, 0.0)

    def extent(text: str) -> float:
        return letter * len(text) if is_x else _LINE

    most = max(2, int(inches / apart))
    kept = {text for *_, text in scale.labels(inches, most, extent, gap)}
    ticks = scale.ticks(most)
    return [value for value, _ in ticks], [text if text in kept else "" for _, text in ticks]


def _draw_mark(axes: Axes, page: Page, plot: Plot, mark: Bars | Line | Dots | Rule) -> None:
    ink = getattr(page.inks, mark.ink)
    if isinstance(mark, Bars):
        widths = np.diff(mark.edges)
        middles = mark.edges[:-1] + widths / 2
        for counts, colour in ((mark.whole, page.inks.faint), (mark.part, ink)):
            axes.bar(middles, counts, width=0.92 * widths, color=colour, linewidth=0)
    elif isinstance(mark, Line):
        width = 1.2 if mark.ink in ("faint", "unselected") else 1.6
        style = (0, (3, 2)) if mark.dashed else "-"
        crosses = bool(((mark.y < plot.y.low) | (mark.y > plot.y.high)).any())
        axes.plot(
            mark.x, mark.y, color=ink, linewidth=width, linestyle=style, label=mark.name or None,
            clip_on=crosses or bool(((mark.x < plot.x.low) | (mark.x > plot.x.high)).any()),
        )  # fmt: skip
    elif isinstance(mark, Dots):
        _draw_dots(axes, page, plot, mark)
    else:
        line = axes.axvline if mark.axis == "x" else axes.axhline
        scale = plot.x if mark.axis == "x" else plot.y
        at = min(max(mark.at, scale.low), scale.high)
        if mark.dashed:
            line(at, color=ink, linewidth=1.2, linestyle=(0, (3, 2)), zorder=4)
        else:
            line(at, color=page.inks.faint, linewidth=0.8, zorder=0)


def _draw_dots(axes: Axes, page: Page, plot: Plot, dots: Dots) -> None:
    """Markers with their intervals; an arrow with the number where y is beyond the scale."""
    ink = getattr(page.inks, dots.ink)
    at, low, high = dots.x * dots.shift, plot.y.low, plot.y.high
    marker, is_filled = MARKERS[dots.sign or dots.ink]  # type: ignore[index]
    if dots.low is not None and dots.high is not None:
        known = np.isfinite(dots.low) & np.isfinite(dots.high)
        ends = np.clip([dots.low[known], dots.high[known]], low, high)
        axes.vlines(at[known], *ends, color=ink, linewidth=1.3)
    inside = (dots.y >= low) & (dots.y <= high)
    axes.plot(at[inside], dots.y[inside], marker=marker, markersize=5.5, color=ink,
              markerfacecolor=ink if is_filled else page.inks.background, linestyle="none",
              zorder=5, clip_on=False, label=dots.name or None)  # fmt: skip
    bounds = np.empty((0, len(at)))
    if dots.low is not None and dots.high is not None:
        bounds = np.stack([dots.low, dots.high])
    for place in np.flatnonzero(np.isfinite(dots.y)).tolist():
        for end, arrow, is_beyond in (
            (high, "↑", lambda value: value > high), (low, "↓", lambda value: value < low)
        ):  # fmt: skip
            y = float(dots.y[place])
            if is_beyond(y) or is_beyond(bounds[:, place]).any():
                number = f" {short_number(y)}".replace("-", "−") if is_beyond(y) else ""
                near_end = plot.x.fraction(at[place]) > 0.85
                axes.annotate(
                    f"{arrow}{number}", (at[place], end), xytext=(-6 if near_end else 6, 0),
                    textcoords="offset points", ha="right" if near_end else "left", va="center",
                    fontsize=8.5, color=ink, zorder=6,
                )  # fmt: skip
