"""Latency of the prediction and the heatmap of one instance while a slider moves."""

from __future__ import annotations

import shutil
import statistics
import tempfile
from collections.abc import Iterator
from itertools import count
from pathlib import Path

import s2rstore
from bench import slider_latency
from bench.budget import BudgetRow, seconds
from bench.measured_stores import QUIET, frames_store, lively
from s2rtools.adjustments import make_chain
from s2rtools.interactive import LiveModel
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute

_MOVES = 15


def figures(threads: int) -> Iterator[BudgetRow]:
    """posest at 256 x 256, brightness of the real side; milliseconds from value to result."""
    folder = Path(tempfile.mkdtemp())
    try:
        path = frames_store(folder / "s.s2r", 4, 256, lively("posest"))
        with s2rstore.open(path) as store:
            live = LiveModel(store, "r", threads=threads)
        for kinds, budget in (((), 150.0), (("activation",), None), (("feature_distance",), None)):
            step = count(1)

            def moved(kinds: tuple[str, ...] = kinds, step: count[int] = step) -> None:
                brightness = 1 + 1e-3 * next(step) + (len(kinds[0]) if kinds else 0) * 1e-5
                live.compute(1, {"real": make_chain("real", {"brightness": brightness})}, kinds)

            label = f"live prediction with {kinds[0]}" if kinds else "live prediction"
            yield BudgetRow(label, 1e3 * seconds(moved, _MOVES), "ms", budget)
        live.close()
        precompute(path, QUIET, ["r"], PrecomputeOptions(("activation",)))
        drawn = slider_latency.milliseconds(path, "r", _MOVES)
        yield BudgetRow("slider to prediction on the screen", statistics.median(drawn), "ms", 150.0)
    finally:
        shutil.rmtree(folder)
