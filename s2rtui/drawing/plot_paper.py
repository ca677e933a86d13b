"""Draw the marks of a plot on axes of matplotlib, and dials on polar axes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.cells import cell_len

from s2rtui.canvas import Pixels, Theme
from s2rtui.canvas.fit_text import fit_text
from s2rtui.canvas.render_options import UNICODE
from s2rtui.drawing.figure_format import value_colours
from s2rtui.drawing.image import Image
from s2rtui.drawing.page import BOLD, LETTER, NARROW, Ink, Inks, Page, style_axes
from s2rtui.drawing.plane_marks import PlaneMark
from s2rtui.drawing.plane_paper import CELLS_PER_INCH, draw_plane_mark
from s2rtui.drawing.plot import Bars, Dots, Line, Phrase, Plot, Points, Rule, Sign
from s2rtui.drawing.plot_cells import RING
from s2rtui.drawing.scale import Scale, short_number

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes


_X_TICKS, _Y_TICKS = 0.7, 0.35
"""Inches between ticks at least."""
_LINE = 0.17
"""Height of a label in inches."""
_BESIDE = 0.2
"""Inches beside an axis of x into which its labels may reach."""
_SCREEN_DPI = 110.0
"""Pixels per inch of dials on the screen of a terminal with graphics."""
LEGEND_COLUMNS = 2
_SMALLEST_TITLE = 6.0
"""Points of the smallest font of a title of an image."""
_MARKERS: dict[Sign, tuple[str, bool]] = {
    "sim": ("D", True), "real": ("D", False), "truth": ("o", True), "both": ("s", True),
    "cursor": ("o", False), "pointer": (">", True), "selected": ("o", True),
    "trained": ("o", False),
    "baseline": ("|", True), "vertical": ("|", True), "passed": ("o", True), "failed": ("^", True),
    "inconclusive": ("o", False), "skipped": (".", True), "interval": ("_", True),
    "planned": (">", True),
    "below": ("v", True), "above": ("^", True),
}  # fmt: skip
"""The marker of each sign, and whether it is filled."""


def draw_plot(
    axes: Axes, page: Page, plot: Plot, inches: tuple[float, float], has_x: bool, has_y: bool,
    has_title: bool = True,
) -> None:  # fmt: skip
    """Draw a plot in `inches` (width, height) with the labels of x and the name of y if wanted."""
    font = 8 if page.inches[0] <= NARROW else 9
    if plot.image is not None:
        _draw_image(axes, page, plot, plot.image)
        axes.set_axis_off()
        if has_y:
            axes.text(-0.1 / inches[0], 0.5, axis_name(plot.y, inches[1]), rotation=90,
                      transform=axes.transAxes, ha="right", va="center", fontsize=9,
                      color=page.inks.muted)  # fmt: skip
        if has_title and plot.title:
            _draw_title(axes, page, plot, inches[0])
        return
    width, height = inches
    style_axes(axes, page)
    for spine in axes.spines.values() if plot.is_tight else ():
        spine.set_visible(True)
    draw_marks(axes, page, plot, inches)
    set_ticks(axes, page, plot.x, width)
    set_ticks(axes, page, plot.y, height, is_x=False)
    if has_x:
        axes.set_xlabel(axis_name(plot.x, width))
    else:
        axes.tick_params(labelbottom=False)
    if has_y:
        axes.set_ylabel(axis_name(plot.y, height))
    if plot.title:
        room = width / LETTER - BOLD * (font + 1) * cell_len(_draw_title(axes, page, plot, width))
        _draw_phrases(axes, page, plot.title[1:], font, room / font - 2)
    elif plot.legend:
        axes.legend(
            loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0, ncols=LEGEND_COLUMNS,
            fontsize=font, frameon=False, labelcolor=page.inks.text,
        )  # fmt: skip


def _draw_phrases(
    axes: Axes, page: Page, phrases: Sequence[Phrase], font: float, room: float
) -> None:
    """Write texts in their inks above the right end of a plot, as many as `room` letters hold."""
    from matplotlib.offsetbox import AnchoredOffsetbox, HPacker, TextArea

    texts: list[str] = []
    areas: list[Artist] = []
    for phrase in phrases:
        text = phrase.whole(UNICODE)
        if cell_len("   ".join([*texts, text])) <= room:
            texts.append(text)
            areas.append(
                TextArea(
                    text, textprops={"fontsize": font, "color": getattr(page.inks, phrase.ink)}
                )
            )
    packed = HPacker(children=areas, pad=0, sep=1.2 * font)
    axes.add_artist(
        AnchoredOffsetbox(
            "lower right", child=packed, frameon=False, pad=0, borderpad=0.3,
            bbox_to_anchor=(1, 1), bbox_transform=axes.transAxes,
        )
    )  # fmt: skip


def _draw_title(axes: Axes, page: Page, plot: Plot, width: float) -> str:
    """Write the first text of the title, its short form, or what fits into `width` inches of it.

    Those of images become smaller first. Returns the text.
    """
    title, font = plot.title[0], 9.0 if page.inches[0] <= NARROW else 10.0
    letters = int(width / (LETTER * BOLD * font))
    fits = cell_len(title.text) <= letters or not title.short
    text = title.text if fits else title.short
    if plot.image is not None and cell_len(text) > letters:
        font = max(_SMALLEST_TITLE, width / (LETTER * BOLD * cell_len(text)))
        letters = int(width / (LETTER * BOLD * font) + 1e-6)
    text = fit_text(text, letters, "…")
    axes.set_title(text, loc="left", fontsize=font, pad=5, fontweight="bold",
                   color=getattr(page.inks, title.ink))  # fmt: skip
    return text


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

    wide, high = page.inches
    page.figure.add_artist(Line2D([x / wide], [y / high], **marker_style(page, sign, ink)))


def marker_style(page: Page, sign: Sign, ink: Ink) -> dict[str, Any]:
    """How matplotlib draws the marker of a sign."""
    marker, is_filled = _MARKERS[sign]
    return {"marker": marker, "markersize": 5.5, "color": ink, "linestyle": "none",
            "markerfacecolor": ink if is_filled else page.inks.background}  # fmt: skip


def set_ticks(axes: Axes, page: Page, scale: Scale, inches: float, is_x: bool = True) -> None:
    """Set the ticks of an axis with labels that keep apart, as far as they reach beyond it."""
    from matplotlib.transforms import ScaledTranslation

    axis, moved = axes.xaxis if is_x else axes.yaxis, dict[str, float]()
    letter = LETTER * 8
    apart, gap, beyond = (_X_TICKS, letter, _BESIDE) if is_x else (_Y_TICKS, 0.0, math.inf)

    def extent(text: str) -> float:
        return letter * cell_len(text) if is_x else _LINE

    most = max(2, int(inches / apart))
    for start, at, text in scale.labels(inches, most, extent, gap, beyond):
        moved[text] = start + extent(text) / 2 - at
    ticks = scale.ticks(most)
    texts = [text if text in moved else "" for _, text in ticks]
    axis.set_ticks([value for value, _ in ticks], texts)
    axis.set_ticks([], minor=True)
    for label, text in zip(axis.get_ticklabels(), texts, strict=True):
        if is_x and abs(moved.get(text, 0.0)) > 1e-6:
            shift = ScaledTranslation(moved[text], 0.0, page.figure.dpi_scale_trans)
            label.set_transform(label.get_transform() + shift)


def draw_marks(
    axes: Axes, page: Page, plot: Plot, inches: tuple[float, float], is_page: bool = True
) -> None:
    """The ends of both scales, and the marks."""
    for name, scale in (("x", plot.x), ("y", plot.y)):
        if scale.log:
            getattr(axes, f"set_{name}scale")("log")
        axes.set(**{f"{name}lim": (scale.low, scale.high)})
    for mark in plot.marks:
        if isinstance(mark, PlaneMark | Points):
            draw_plane_mark(axes, page, plot, mark, inches, is_page)
        elif not isinstance(mark, Image):
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
    return scale.name(width, lambda text: LETTER * 9 * cell_len(text)) or names[-1]


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
    if dots.low is not None and dots.high is not None:
        known = np.isfinite(dots.low) & np.isfinite(dots.high)
        ends = np.clip([dots.low[known], dots.high[known]], low, high)
        axes.vlines(at[known], *ends, color=ink, linewidth=1.3)
    inside = (dots.y >= low) & (dots.y <= high)
    axes.plot(at[inside], dots.y[inside], zorder=5, clip_on=False, label=dots.name or None,
              **marker_style(page, dots.drawn_sign, ink))  # fmt: skip
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


_LABEL_LINE, _HEAD, _LABEL_FONT = 0.2, 0.25, 8
"""Inches of a label and of a title, and font size of labels."""
_SIDE = 0.36
"""Inches beside a disc, for labels of x."""
_LARGEST = 1.6
"""Inches of a disc on a page that is as high as its parts."""
_MARGIN, _PADDING = 0.15, 0.1
"""Inches at the left and right of a row of dials, and of each dial."""
_BETWEEN = 12
"""Degrees beside a label of y in which its bars may cover it."""


def draw_dials(page: Page, plots: Sequence[Plot], below: float, is_beside: bool) -> None:
    """Draw dials of equal size above `below` inches, beside each other or above each other."""
    columns, rows = (len(plots), 1) if is_beside else (1, len(plots))
    width = (page.inches[0] - 2 * _MARGIN) / columns
    height = max(0.3, (page.top - below) / rows)
    for place, plot in enumerate(plots):
        column, row = place % columns, place // columns
        left, top = _MARGIN + column * width, page.top - row * height
        _draw_dial(page, plot, (left, top - height, width, height))


def dial_inches(width: float) -> float:
    """The height of a dial, with its title and labels, on a page that is as high as its parts."""
    return min(width - 2 * _SIDE, _LARGEST) + _HEAD + 3 * _LABEL_LINE


def dial_pixels(plot: Plot, theme: Theme, size: tuple[int, int]) -> Pixels:
    """The disc of a plot, without labels, in the middle of `size` (height, width) pixels."""

    def draw(page: Page) -> None:
        wide, high = page.inches
        across = 0.96 * min(wide, high)
        axes = _disc(page, plot, ((wide - across) / 2, (high - across) / 2, across))
        axes.set_xticklabels([])
        axes.set_yticklabels([])

    return drawn_pixels(theme, size, draw)


def _draw_dial(page: Page, plot: Plot, box: tuple[float, float, float, float]) -> None:
    """Draw a dial in a box (left, bottom, width, height): name at the left, texts at the right.

    They stand beside the upper label of x where there is room, else above it.
    """
    left, bottom, width, height = box
    font = 8 if page.inches[0] <= NARROW else 9
    name = plot.title[0].text if plot.title else ""
    wide = LETTER * len(name) * (font + 1) * BOLD
    room = (width - 3 * _PADDING - wide) / (LETTER * font)
    texts = "   ".join(phrase.whole(UNICODE, room).replace("-", "−") for phrase in plot.title[1:])
    head = 0.0 if width / 2 > max(wide, LETTER * font * len(texts)) + 0.4 else _HEAD
    across = max(0.2, min(width - 2 * _SIDE, height - head - 3 * _LABEL_LINE))
    bottom += (height - head - across) / 2
    axes = _disc(page, plot, (left + (width - across) / 2, bottom, across))
    axes.tick_params(axis="x", colors=page.inks.muted, labelsize=_LABEL_FONT, pad=1)
    axes.set_rlabel_position(_free_direction(plot))
    axes.tick_params(axis="y", colors=page.inks.text, labelsize=_LABEL_FONT, pad=0)
    for label in axes.get_yticklabels():
        label.set(path_effects=page.halo(2), zorder=6, ha="center", va="center")
    top = bottom + across + 0.06 + head
    if plot.title:
        ink = getattr(page.inks, plot.title[0].ink)
        page.text(left + _PADDING, top, name, ink, font + 1, fontweight="bold")
        page.text(left + width - _PADDING, top, texts, page.inks.muted, font, ha="right")


def _disc(page: Page, plot: Plot, box: tuple[float, float, float]) -> Any:
    """Polar axes in a square (left, bottom, side) with the marks of a plot."""
    left, bottom, side = box
    axes: Any = page.axes(left, bottom, side, side, projection="polar")
    inks, low, high = page.inks, plot.y.low, plot.y.high
    axes.set_facecolor(inks.background)
    axes.set_theta_zero_location("E")
    axes.set_theta_direction(-1 if plot.turns == "clockwise" else 1)
    axes.set_rorigin(low - (high - low) * RING / (1 - RING))
    axes.set_rlim(low, high)
    set_ticks(axes, page, plot.y, (1 - RING) * side / 2, is_x=False)
    ticks = {degrees % 360: f"{text}°".replace("-", "−") for degrees, text in plot.x.ticks(4)}
    axes.set_xticks(np.radians(list(ticks)), list(ticks.values()))
    axes.set_xlim(0, 2 * np.pi)
    axes.grid(color=inks.faint, linewidth=0.6)
    axes.spines["polar"].set_color(inks.faint)
    axes.spines["inner"].set_color(inks.muted)
    for mark in plot.marks:
        if isinstance(mark, Bars):
            middles = np.radians((mark.edges[:-1] + mark.edges[1:]) / 2)
            widths = np.radians(np.diff(mark.edges))
            style = {"bottom": low, "linewidth": 0}
            axes.bar(middles, mark.whole - low, width=widths, color=inks.faint, zorder=2, **style)
            axes.bar(middles, mark.part - low, width=0.86 * widths,
                     color=getattr(inks, mark.ink), zorder=3, **style)  # fmt: skip
        elif isinstance(mark, Dots):
            ink, turn = getattr(inks, mark.ink), np.radians(mark.x)
            axes.vlines(turn, low, mark.y, color=ink, linewidth=1.1, zorder=5)
            style = marker_style(page, mark.drawn_sign, ink)
            axes.plot(turn, mark.y, zorder=5, clip_on=False, **style)
    return axes


def _free_direction(plot: Plot) -> float:
    """Degrees between the ticks of x in which the bars are the shortest."""

    def longest(degrees: float) -> float:
        lengths = [0.0]
        for bars in (mark for mark in plot.marks if isinstance(mark, Bars)):
            middles = (bars.edges[:-1] + bars.edges[1:]) / 2
            near = np.abs((middles - degrees + 180) % 360 - 180) < _BETWEEN
            lengths += np.maximum(bars.part, bars.whole)[near].tolist()
        return max(lengths)

    directions = [turn + aside for aside in (45.0, 60.0, 30.0) for turn in (0, 90, 180, 270)]
    return min(directions, key=longest)
