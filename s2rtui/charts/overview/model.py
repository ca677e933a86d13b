"""The numbers of the overview: accuracies of every run, their scale, and translators."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np

from s2rstore.metrics import run_metrics
from s2rstore.metrics.recall import headline
from s2rstore.reader import Store
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.charts.scene import OverviewRow, TranslatorGain, TranslatorRow
from s2rtui.drawing.row_lines import RowLines
from s2rtui.drawing.scale import Floats, Scale, tick_step

MOST_READ = 1000
"""Most translators, and most gains, that are read from a store."""
_GAINS = (
    "SELECT translator, run, value, low, high, metric = 'trained_error_gain' "
    "FROM translator_metric WHERE metric IN ('error_gain', 'trained_error_gain') "
    "AND reference = 'translator' AND value IS NOT NULL "
    f"ORDER BY metric, translator, run LIMIT {MOST_READ}"
)


def overview_rows(
    store: Store, runs: Sequence[str] | None = None
) -> tuple[list[OverviewRow], float]:
    """A row per computed run, or per run in `runs`, and the baseline of the first run.

    Accuracies leave out the instances that the model was trained on.
    """
    rows = []
    for name in runs or [name for name, run in store.runs.items() if run.key]:
        sim, real = (run_metrics.side_metrics(store, name, side) for side in ("sim", "real"))
        note = real.accuracy.no_bounds if real.n else "the model was trained on every instance"
        headlines = headline(store, name, "sim"), headline(store, name, "real")
        rows.append(OverviewRow(name, sim.accuracy, real.accuracy, real.n, note, headlines))
    return rows, run_metrics.baseline_accuracy(store, rows[0].run) if rows else math.nan


def accuracy_scale(
    rows: Sequence[OverviewRow], baseline: float, lines: RowLines | None, names: tuple[str, ...]
) -> Scale:
    """The scale of accuracies that holds all rows and the baseline, rounded outwards in 0 .. 1.

    With lines it holds the 1st percentile of the valid instances of every run, and 1.
    """
    numbers = [baseline]
    for accuracy in (side for row in rows for side in (row.sim, row.real)):
        numbers += [accuracy.value, *(accuracy.bounds if accuracy.is_known else ())]
    if lines is not None:
        numbers += [1.0, *_lowest(lines.values, lines.valid)]
    known = [value for value in numbers if math.isfinite(value)] or [0.0, 1.0]
    step = tick_step(max(max(known) - min(known), 0.02), 4)
    low = max(0.0, round(math.floor(min(known) / step + 1e-9) * step, 9))
    high = max(low + step, round(math.ceil(max(known) / step - 1e-9) * step, 9))
    return Scale(low, min(max(1.0, low + step), high), names, percent=True)


@cached_by_identity(8)
def _lowest(columns: tuple[Floats, ...], valid: Bools) -> list[float]:
    """The 1st percentile of the valid known accuracies of each run."""
    known = (column[valid & np.isfinite(column)] for column in columns)
    return [float(np.percentile(column, 1)) for column in known if column.size]


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
