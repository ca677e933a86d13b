"""`s2r runs`: the runs of a store with their figures, beside the constant-prediction baseline."""

from __future__ import annotations

import argparse

from s2rtui.cli import output

_NAMES = (
    "run", "model", "sim", "real", "sim n", "sim accuracy %", "sim 95 %", "sim median m",
    "real n", "real accuracy %", "real 95 %", "real median m", "baseline %", "note",
)  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("store")
    output.add_format(parser)


def execute(options: argparse.Namespace) -> int:
    import s2rstore
    from s2rstore import headlines

    rows = []
    with s2rstore.open(options.store) as store:
        for run in store.runs.values():
            sides: list[object] = []
            for side in ("sim", "real"):
                found = headlines.headline(store, run.run, side) if run.key else None
                sides += _side(found)
            truth = store.instances
            baseline = headlines.baseline(store) if len(truth) else float("nan")
            domains = [_described(run.domain(s), run.adjustments(s)) for s in ("sim", "real")]
            note = "" if run.key else "not computed: s2r precompute"
            rows.append((run.run, run.model, *domains, *sides, round(100 * baseline, 1), note))
    output.write(_NAMES, rows, options)
    return 0


def _side(found: object) -> list[object]:
    from s2rstore.headlines import Headline

    if not isinstance(found, Headline):
        return [None, None, None, None]
    span = (
        f"{100 * found.accuracy.low:.1f}..{100 * found.accuracy.high:.1f}" if found.n > 1 else "-"
    )
    if not found.n:
        return [0, None, "all trained on", None]
    return [found.n, round(100 * found.accuracy.value, 1), span, round(found.median_error, 3)]


def _described(domain: str, chain: list[dict[str, object]]) -> str:
    steps = [f"{step['name']}={step['value']:g}" for step in chain]
    return domain + (f" ({', '.join(steps)})" if steps else "")
