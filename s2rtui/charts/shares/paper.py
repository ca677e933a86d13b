"""The shares on paper: a bar per factor with its interval."""

from __future__ import annotations

import math
import textwrap

from s2rstore.errors import RequestError
from s2rtui.canvas import LIGHT, Theme
from s2rtui.charts.shares.model import CONTRIBUTION, SharesInput, shares_model
from s2rtui.drawing.page import LETTER, NARROW, Pixels, new_page, own_settings, style_axes

_LINE = 0.17
"""Height of a line of notes in inches."""


@own_settings()
def shares_figure(
    data: SharesInput, size: Pixels, theme: Theme = LIGHT, title: str = "", subtitle: str = ""
) -> bytes:
    """Draw the figure in `size` pixels. Raises RequestError without shares."""
    model = shares_model(data)
    if model is None:
        raise RequestError("no selected instance has shares of the gap; run `s2r precompute`")
    page = new_page(size, theme, title, subtitle)
    is_narrow = page.inches[0] <= NARROW
    font = 8 if is_narrow else 9
    left = 1.35 if is_narrow else 1.6
    low = 0.7 + (4 if is_narrow else 2) * _LINE
    axes = page.axes(left, low, page.inches[0] - left - 0.4, max(0.3, page.top - low - 0.15))
    style_axes(axes, page)
    for y, bar in enumerate(reversed(model.bars)):
        mean = bar.share.mean
        ink = page.inks.real if mean.value > 0 else page.inks.sim
        axes.barh(y, mean.value, height=0.6, color=ink, linewidth=0)
        if math.isfinite(mean.low):
            axes.plot([mean.low, mean.high], [y, y], color=page.inks.text, linewidth=1.2)
        axes.plot([bar.overall], [y], marker="D", markersize=5, color=page.inks.truth,
                  linestyle="none", zorder=5)  # fmt: skip
        axes.text(0.0, y + 0.34, f" {bar.text}", fontsize=font, color=page.inks.text, va="bottom")
    axes.axvline(0, color=page.inks.muted, linewidth=0.8)
    axes.set_yticks(range(len(model.bars)), [bar.factor for bar in reversed(model.bars)])
    axes.set_ylim(-0.6, len(model.bars) - 0.2)
    axes.set_xlabel("mean share of the gap (m)")
    notes = [
        f"{model.counted}; diamond: all instances; line: 95 % interval for all factors at once",
        CONTRIBUTION,
    ]
    letters = max(20, int((page.inches[0] - 0.6) / (LETTER * font)))
    lines = [line for note in notes for line in textwrap.wrap(note, letters)]
    for row, line in enumerate(reversed(lines)):
        page.text(0.3, 0.1 + row * _LINE, line, page.inks.muted, font)
    return page.encoded()
