"""Translators of the store as rows below the overview: verdict, and gain in metres."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich.cells import set_cell_size

from s2rstore.reader import Store
from s2rtui.canvas import Canvas, RenderOptions, Size
from s2rtui.charts.scene import TranslatorRow
from s2rtui.charts.shared.axis_scale import Interval

MOST_ROWS = 6
"""Rows of the block at most, its header included."""
_GAINS = (
    "SELECT translator, run, value, low, high FROM translator_metric "
    "WHERE metric IN ('error_gain', 'trained_error_gain') AND reference = 'translator' "
    "AND value IS NOT NULL "
    "ORDER BY translator, value DESC"
)


def translator_rows(store: Store) -> tuple[TranslatorRow, ...]:
    """A row per translator with its best gain: accepted ones first, the largest gain first."""
    best: dict[str, tuple[str, float, Interval | None]] = {}
    if store.has_table("translator_metric"):
        for name, run, value, low, high in store.execute(_GAINS):
            known = None if low is None or high is None else (low, high)
            best.setdefault(name, (str(run), float(value), known))
    rows = []
    for record in store.translators.values():
        run, gain, interval = best.get(record.translator, ("", None, None))
        rows.append(
            TranslatorRow(record.translator, record.direction, record.accepted, gain, interval, run)
        )
    return tuple(sorted(rows, key=lambda row: (row.accepted is not True, -(row.gain or -math.inf))))


def block_height(rows: Sequence[TranslatorRow], runs: int, height: int) -> int:
    """Rows of the block in a view of `height` rows with `runs` runs; 0 where it does not fit."""
    wanted = min(MOST_ROWS, len(rows) + 1) if rows else 0
    return wanted if height - wanted >= runs + 3 else 0


def draw_translators(rows: Sequence[TranslatorRow], size: Size, options: RenderOptions) -> Canvas:
    """The block in `size` (columns, rows): a header, then the first translators that fit."""
    canvas = Canvas(*size, options)
    theme, shown = canvas.theme, rows[: max(0, size[1] - 1)]
    more = f", {len(shown)} of {len(rows)}" if len(shown) < len(rows) else ""
    canvas.text(2, 0, f"translators{more}"[: size[0] - 2], theme.muted)
    longest = max((len(row.translator) for row in shown), default=0)
    name = max(4, min(longest, 24, size[0] // 3))
    for y, row in enumerate(shown, start=1):
        text = options.printable(row.translator)
        if len(text) > name:
            text = set_cell_size(text, name - 1) + canvas.glyphs.ellipsis
        colour = theme.sim if row.direction == "sim2real" else theme.real
        canvas.text(2, y, text, colour)
        left = name + 3
        ink = theme.text if row.accepted else theme.muted
        left = canvas.text(left, y, row.verdict[: max(0, size[0] - left)], ink) + 2
        canvas.text(left, y, row.gain_text[: max(0, size[0] - left)], theme.text)
    return canvas
