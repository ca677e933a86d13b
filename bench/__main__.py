"""Run all measurements, or those named by --only."""

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
    inference,
    live_prediction,
    occlusion_speed,
    precompute_memory,
    scale,
    startup,
    terminal_bytes,
    time_delay,
)
from bench.budget import BudgetRow
from bench.measured_stores import QUIET

_ROOMS = (
    "startup", "wire", "scale", "projection", "occlusion", "inference", "live", "memory", "delay",
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object per line")
    parser.add_argument("--only", choices=_ROOMS, action="append", help="repeatable")
    parser.add_argument("--store", type=Path, help="for startup and wire: a computed store")
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    options = parser.parse_args()
    wanted = options.only or list(_ROOMS)
    failed = 0
    folder = Path(tempfile.mkdtemp())
    try:
        for figure in _all(wanted, options, folder):
            failed += not figure.ok
            print(json.dumps(figure.row()) if options.json else _line(figure), flush=True)
    finally:
        shutil.rmtree(folder)
    return 1 if failed else 0


def _all(wanted: list[str], options: argparse.Namespace, folder: Path) -> Iterator[BudgetRow]:
    if {"startup", "wire"} & set(wanted):
        store = options.store or _computed(folder)
        if "startup" in wanted:
            yield from startup.figures(store)
        if "wire" in wanted:
            yield from terminal_bytes.figures(store)
    if "scale" in wanted:
        yield from scale.figures(folder)
    if "projection" in wanted:
        yield from back_projection.figures()
    if "occlusion" in wanted:
        yield from occlusion_speed.figures(options.threads)
    if "inference" in wanted:
        yield from inference.figures(options.threads)
    if "live" in wanted:
        yield from live_prediction.figures(options.threads)
    if "memory" in wanted:
        yield from precompute_memory.figures((1_000, 100_000))
    if "delay" in wanted:
        yield from time_delay.figures()


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


def _line(figure: BudgetRow) -> str:
    budget = "reference" if figure.budget is None else f"{figure.sense} {figure.budget:g}"
    state = "" if figure.ok else "  OVER"
    return f"{figure.name:<55} {figure.value:10.4g} {figure.unit:<9} {budget}{state}"


if __name__ == "__main__":
    sys.exit(main())
