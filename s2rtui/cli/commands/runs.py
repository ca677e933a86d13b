"""`s2r runs`: the runs of a store with their figures, beside the constant-prediction baseline."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from s2rstore.metrics.bootstrap import LEVEL_TEXT
from s2rtui.cli.formatting import rows as output

if TYPE_CHECKING:
    from s2rstore.metrics.run_metrics import Headline

_NAMES = (
    "run", "model", "sim", "real", "n", "trained on", "sim accuracy %", f"sim {LEVEL_TEXT}",
    "sim median m", "real accuracy %", f"real {LEVEL_TEXT}", "real median m", "baseline %", "note",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store")
    output.add_format(parser)


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore.metrics import run_metrics
    from s2rstore.records import SIDES

    rows = []
    with s2rstore.open(options.store) as store:
        for run in store.runs.values():
            domains = [_described(run.domain(s), run.adjustments(s)) for s in SIDES]
            if run.key is None:
                figures: list[object] = [None] * 9
                note = "not computed: s2r precompute"
            else:
                sides = [run_metrics.headline(store, run.run, side) for side in SIDES]
                baseline = round(100 * run_metrics.baseline(store, run.run), 1)
                figures = [sides[0].n, sides[0].trained_on, *_side(sides[0]), *_side(sides[1]),
                           baseline if sides[0].n else None]  # fmt: skip
                note = "" if sides[0].n else "trained on every instance"
            rows.append((run.run, run.model, *domains, *figures, note))
    output.write(_NAMES, rows, options)
    return 0


def _side(found: Headline) -> list[object]:
    """Accuracy in percent, its interval, and the median error in metres."""
    if found.n < 2:
        return [None, None, None]
    span = f"{100 * found.accuracy.low:.1f}..{100 * found.accuracy.high:.1f}"
    return [round(100 * found.accuracy.value, 1), span, round(found.median_error, 3)]


def _described(domain: str, chain: list[dict[str, object]]) -> str:
    steps = [f"{step['name']}={step['value']:g}" for step in chain]
    return domain + (f" ({', '.join(steps)})" if steps else "")
