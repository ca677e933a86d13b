"""Translators of the store as rows below the overview: verdict, and gain on the present run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice

from rich.cells import cell_len

from s2rstore.reader import Store
from s2rtui.canvas import Canvas, RenderOptions, Size
from s2rtui.canvas.fit_text import fit_text
from s2rtui.charts.scene import TranslatorGain, TranslatorRow

MOST_ROWS = 6
"""Rows of the block at most, its header included."""
MOST_READ = 1000
"""Most translators, and most gains, that are read from a store."""
_GAINS = (
    "SELECT translator, run, value, low, high, metric = 'trained_error_gain' "
    "FROM translator_metric WHERE metric IN ('error_gain', 'trained_error_gain') "
    "AND reference = 'translator' AND value IS NOT NULL "
    f"ORDER BY metric, translator, run LIMIT {MOST_READ}"
)


def translator_rows(store: Store) -> tuple[TranslatorRow, ...]:
    """A row per translator with its gains, in the order of the store."""
    gains: dict[str, list[TranslatorGain]] = {}
    for name, run, value, low, high, trained in store.execute(_GAINS):
        interval = None if low is None or high is None else (low, high)
        gain = TranslatorGain(str(run), float(value), interval, bool(trained))
        gains.setdefault(name, []).append(gain)
    return tuple(
        TranslatorRow(name, record.direction, record.accepted, tuple(gains.get(name, ())))
        for name, record in islice(store.translators.items(), MOST_READ)
    )


def ordered(rows: Sequence[TranslatorRow], run: str) -> list[TranslatorRow]:
    """Accepted translators first, then those with the largest gain on a run."""

    def rank(row: TranslatorRow) -> tuple[bool, float]:
        gains = [gain.value for gain in row.gains if gain.run == run and not gain.trained]
        return row.accepted is not True, -max(gains, default=-math.inf)

    return sorted(rows, key=rank)


def block_height(rows: Sequence[TranslatorRow], runs: int, height: int) -> int:
    """Rows of the block in a view of `height` rows with `runs` runs; 0 where it does not fit."""
    wanted = min(MOST_ROWS, len(rows) + 1) if rows else 0
    return wanted if height - wanted >= runs + 3 else 0


def draw_translators(
    rows: Sequence[TranslatorRow], run: str, size: Size, options: RenderOptions
) -> Canvas:
    """The block in `size` (columns, rows): a header, then the first translators that fit.

    Gains are those on `run`.
    """
    canvas = Canvas(*size, options)
    theme, shown = canvas.theme, ordered(rows, run)[: max(0, size[1] - 1)]
    more = f", {len(shown)} of {len(rows)}" if len(shown) < len(rows) else ""
    canvas.text(2, 0, fit_text(f"translators{more}", size[0] - 2), theme.muted)
    longest = max((cell_len(row.translator) for row in shown), default=0)
    name = max(4, min(longest, 24, size[0] // 3))
    for y, row in enumerate(shown, start=1):
        text = options.printable(row.translator)
        text = fit_text(text, name, canvas.glyphs.ellipsis)
        colour = theme.sim if row.direction == "sim2real" else theme.real
        canvas.text(2, y, text, colour)
        left = name + 3
        ink = theme.text if row.accepted else theme.muted
        left = canvas.text(left, y, fit_text(row.verdict, max(0, size[0] - left)), ink) + 2
        gain = options.printable(row.gain_text(run))
        gain = fit_text(gain, max(0, size[0] - left), canvas.glyphs.ellipsis)
        canvas.text(left, y, gain, theme.text)
    return canvas
