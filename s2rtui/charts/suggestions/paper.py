"""The suggestions on paper: for each direction the gain against the number of changes."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from s2rstore.suggestions import SuggestReport
from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.suggestions.model import (
    Direction,
    details,
    evidence_text,
    finite,
    gain_scale,
)
from s2rtui.drawing.page import (
    LETTER,
    NARROW,
    Page,
    Pixels,
    new_page,
    own_settings,
    set_panel_title,
    style_axes,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINE = 0.16
"""Height of a line of notes in inches."""
_TITLES = {"real": "adapt the real images", "sim": "tune the simulator"}
_LEFT, _BELOW, _ABOVE = 0.85, 0.55, 0.35
"""Space of a panel for its labels and its title, in inches."""
_SMALLEST = 0.7
"""Height of the smallest panel in inches."""


@own_settings()
def suggestions_figure(
    directions: Sequence[Direction], size: Pixels, theme: Theme = LIGHT, title: str = "",
    subtitle: str = "",
) -> bytes:  # fmt: skip
    """Draw the figure in `size` pixels: a panel for each direction that has a report."""
    page = new_page(size, theme, title, subtitle)
    wide = page.inches[0]
    font = 7 if wide <= NARROW else 9
    letters = max(20, int((wide - 0.6) / (LETTER * font)))
    lines = [line for note in _notes(directions) for line in _wrapped(note, letters)]
    drawn = [direction.report for direction in directions if direction.report is not None]
    side_by_side = wide > NARROW and len(drawn) > 1
    rows, columns = (1, len(drawn)) if side_by_side else (len(drawn), 1)
    needed = rows * (_ABOVE + _BELOW + _SMALLEST)
    fits = max(0, int((page.top - needed - 0.2) / _LINE))
    low = 0.15 + min(len(lines), fits) * _LINE
    width, height = (wide - 0.3) / columns, (page.top - low) / rows
    for number, report in enumerate(drawn):
        left = 0.15 + (number % columns) * width
        bottom = low + (rows - 1 - number // columns) * height
        place = (left + _LEFT, bottom + _BELOW, width - _LEFT - 0.15, height - _BELOW - _ABOVE)
        _draw_front(page, page.axes(*place), report, font)
    if len(lines) > fits > 0:
        lines[fits - 1] = f"{len(lines) - fits + 1} more lines on a larger page"
    for row, line in enumerate(lines[:fits]):
        page.text(0.3, low - 0.1 - (row + 0.5) * _LINE, line, page.inks.muted, font, va="center")
    return page.encoded()


def _wrapped(note: str, letters: int) -> list[str]:
    return textwrap.wrap(note, letters, subsequent_indent="   ", break_on_hyphens=False)


def _draw_front(page: Page, axes: Axes, report: SuggestReport, font: float) -> None:
    """Gains on held-out instances with intervals, on the fit, and the price of the changes."""
    inks = page.inks
    style_axes(axes, page)
    set_panel_title(axes, _TITLES[report.side], inks.text)
    scale, unit = (1.0, "m") if report.side == "real" else (100.0, "%")
    colour = inks.real if report.side == "real" else inks.sim
    most = max((len(answer.changes) for answer in report.answers), default=1)
    axes.axhline(0, color=inks.muted, linewidth=0.8)
    price = scale * report.price_of_a_change
    axes.plot([0, most + 0.5], [0, price * (most + 0.5)], ":", color=inks.text, linewidth=1.0)
    sizes = [len(answer.changes) for answer in report.answers]
    fitted = [scale * answer.fitted for answer in report.answers]
    axes.plot([0, *sizes], [0.0, *fitted], "--", color=inks.muted, linewidth=1.0)
    for place, (count, answer) in enumerate(zip(sizes, report.answers, strict=True)):
        gain = scale * answer.gain.value
        bounds = np.nan_to_num(scale * np.array([[answer.gain.low], [answer.gain.high]]) - gain)
        axes.errorbar(
            [count], [gain], yerr=np.abs(bounds), color=colour, fmt="o", capsize=4, linewidth=1.4,
            markersize=9 if place == report.best else 6,
            markerfacecolor=colour if answer.evident else inks.background,
        )  # fmt: skip
    axes.set_xlim(-0.2, most + 0.5)
    axes.set_ylim(*_limits(report, scale))
    axes.set_xticks(range(most + 1))
    axes.set_xlabel("number of changes (no unit)")
    axes.set_ylabel(f"gain ({unit})")
    if not report.answers:
        axes.text(0.5, 0.6, "nothing helps", transform=axes.transAxes, color=inks.text,
                  fontsize=font + 1, ha="center")  # fmt: skip


def _limits(report: SuggestReport, scale: float) -> tuple[float, float]:
    """The ends of the axis, which holds all gains, intervals and prices."""
    gains = [(each.gain.low, each.gain.high, each.fitted) for each in report.answers]
    values = [scale * value for values in gains for value in finite(values)]
    values += [scale * end for end in gain_scale(report)]
    low, high = min(values), max(values)
    margin = 0.08 * (high - low)
    return low - margin, high + margin


def _notes(directions: Sequence[Direction]) -> list[str]:
    """Each direction with its answers; then what they were judged on and what the marks mean."""
    notes, evidence = [], []
    for direction in directions:
        report, name = direction.report, _TITLES[direction.side]
        if report is None:
            evidence.append(f"{name}: {direction.note}")
            continue
        notes.append(f"{name}: {'* is suggested' if report.helps else report.verdict}")
        for number, answer in enumerate(direction.answers):
            gain = report.gain_interval(answer.gain)
            factors = ", ".join(answer.factors)
            mark = f"{direction.mark(number)}{number + 1}"
            notes.append(f"{mark}  {gain}: {answer.changes_text} ({factors})")
        if report.best is not None:
            notes += details(direction, report.best)
        evidence.append(f"{name}: {evidence_text(report)}")
    legend = (
        "gain: decrease of the mean real error, or of the mismatch of the images; dots: on "
        "held-out instances, with interval, large: suggested, empty: not shown to help; dashed: "
        "on the instances of the fit; dotted: price of the changes"
    )
    return [*notes, *evidence, legend]
