"""Run all measurements, or those that are named."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")

from bench import (
    back_projection,
    cluster,
    collect,
    contrast,
    end_to_end,
    evaluation_sample,
    exchange,
    exchange_buildings,
    faults,
    growth,
    harm,
    harm_cost,
    inference,
    intervals,
    live_prediction,
    map_grids,
    occlusion_speed,
    planning,
    precompute_memory,
    remote,
    rendering,
    scale,
    sheet,
    startup,
    suggest,
    suggest_renderer,
    terminal_bytes,
    time_delay,
    true_pixels,
    verdicts,
)
from bench.budget import BudgetRow
from bench.measured_stores import QUIET

_MEASUREMENTS = (
    "startup",
    "terminal_bytes",
    "true_pixels",
    "remote",
    "contrast",
    "scale",
    "growth",
    "planning",
    "cluster",
    "back_projection",
    "map_grids",
    "occlusion_speed",
    "inference",
    "live_prediction",
    "precompute_memory",
    "time_delay",
    "rendering",
    "harm_cost",
    "sheet",
    "faults",
    "end_to_end",
)
_ON_REQUEST = (
    "harm", "suggest", "suggest_renderer", "collect", "evaluation_sample", "intervals", "exchange",
    "exchange_buildings", "verdicts",
)  # fmt: skip
"""Measurements of more than ten minutes, which run only where they are named."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object per line")
    parser.add_argument(
        "names", nargs="*", metavar="NAME",
        help=f"of {', '.join((*_MEASUREMENTS, *_ON_REQUEST))} (default: all that take less than "
        "ten minutes)",
    )  # fmt: skip
    parser.add_argument(
        "--store",
        type=Path,
        help="a computed store for startup, terminal_bytes, true_pixels, remote and contrast",
    )
    parser.add_argument(
        "--pairs", type=int, help="real pairs for end_to_end, evenly spread (default: all)"
    )
    parser.add_argument(
        "--commit", default=end_to_end.COMMIT,
        help="revision or working tree to compare end_to_end with (default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--seeds", type=int,
        help=f"seeds of collect (default {collect.SEEDS}), worlds of each factor for suggest "
        f"(default {suggest.SEEDS}), rooms of suggest_renderer (default {suggest_renderer.SEEDS})",
    )  # fmt: skip
    parser.add_argument(
        "--repeats", type=int, default=intervals.REPEATS,
        help="simulated series of each row of intervals, exchange, verdicts (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    selected = options.names or list(_MEASUREMENTS)
    unknown = set(selected) - {*_MEASUREMENTS, *_ON_REQUEST}
    if unknown:
        parser.error(f"unknown: {', '.join(sorted(unknown))}")
    failed = 0
    folder = Path(tempfile.mkdtemp())
    try:
        for row in _rows(selected, options, folder):
            failed += not row.ok
            print(json.dumps(row.as_json()) if options.json else _line(row), flush=True)
    finally:
        shutil.rmtree(folder)
    return 1 if failed else 0


def _rows(selected: list[str], options: argparse.Namespace, folder: Path) -> Iterator[BudgetRow]:
    if {"startup", "terminal_bytes", "true_pixels", "remote"} & set(selected):
        store = options.store or _computed(folder)
        if "startup" in selected:
            yield from startup.figures(store)
        if "terminal_bytes" in selected:
            yield from terminal_bytes.figures(store)
        if "true_pixels" in selected:
            yield from true_pixels.figures(store)
        if "remote" in selected:
            yield from remote.figures(store, folder / "remote")
    if "contrast" in selected:
        yield from contrast.figures(options.store)
    if "faults" in selected:
        yield from faults.figures(folder)
    if "scale" in selected:
        yield from scale.figures(folder)
    if "growth" in selected:
        yield from growth.figures(folder)
    if "planning" in selected:
        yield from planning.figures(folder)
    if "cluster" in selected:
        yield from cluster.figures(folder)
    if "back_projection" in selected:
        yield from back_projection.figures()
    if "map_grids" in selected:
        yield from map_grids.figures(folder)
    if "occlusion_speed" in selected:
        yield from occlusion_speed.figures(options.threads)
    if "inference" in selected:
        yield from inference.figures(options.threads)
    if "live_prediction" in selected:
        yield from live_prediction.figures(options.threads)
    if "precompute_memory" in selected:
        yield from precompute_memory.figures((1_000, 100_000))
    if "rendering" in selected:
        yield from rendering.figures(folder / "rendering")
    if "time_delay" in selected:
        yield from time_delay.figures()
    if "sheet" in selected:
        yield from sheet.figures(folder)
    if "harm_cost" in selected:
        yield from harm_cost.figures(folder)
    if "harm" in selected:
        yield from harm.figures(folder)
    if "collect" in selected:
        yield from collect.figures(options.seeds or collect.SEEDS)
    if "evaluation_sample" in selected:
        yield from evaluation_sample.figures()
    if "intervals" in selected:
        yield from intervals.figures(options.repeats)
    if "exchange" in selected:
        yield from exchange.figures(options.repeats)
    if "exchange_buildings" in selected:
        yield from exchange_buildings.figures()
    if "verdicts" in selected:
        yield from verdicts.figures(options.repeats)
    if "suggest" in selected:
        yield from suggest.figures(options.seeds or suggest.SEEDS)
    if "suggest_renderer" in selected:
        yield from suggest_renderer.figures(options.seeds or suggest_renderer.SEEDS)
    if "end_to_end" in selected:
        yield from _end_to_end(options)


def _end_to_end(options: argparse.Namespace) -> Iterator[BudgetRow]:
    data = os.environ.get("S2R_DATA")
    if data:
        yield from end_to_end.figures(Path(data), options.pairs, options.commit)
    else:
        print("end_to_end: skipped, S2R_DATA names no Sim2RealViz data", file=sys.stderr)


def _computed(folder: Path) -> Path:
    """The default world at 256 x 256, with heatmaps of one model."""
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtools.training import pretrained
    from s2rtui.cli import main as s2r

    path = folder / "world.s2r"
    with contextlib.redirect_stdout(sys.stderr):
        s2r(["ingest", "world", "--instances", "32", "--size", "256", "--store", str(path)])
    pretrained.add_pretrained_models(path)
    precompute(path, QUIET, ["vanilla"], PrecomputeOptions(("activation", "feature_distance")))
    return path


def _line(row: BudgetRow) -> str:
    budget = "reference" if row.budget is None else f"{row.sense} {row.budget:g}"
    state = "" if row.ok else "  OVER"
    return f"{row.name:<55} {row.value:10.4g} {row.unit:<9} {budget}{state}"


if __name__ == "__main__":
    sys.exit(main())
