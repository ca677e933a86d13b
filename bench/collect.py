"""Whether poses that `s2r collect` chooses are better training images than random ones.

In the synthetic world, a pretrained model is fine-tuned on real images at 15, 30 and 60 poses of
each method, and judged on real images at random poses that no training saw. Each seed has another
drive as evidence, other held-out poses and other batches, the same for all methods.

`python -m bench.collect --seeds 10 --log results.jsonl` continues a log that an earlier call has
begun; the intervals are those of differences between methods over seeds.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import cast, get_args

import numpy as np
import torch

from bench.budget import BudgetRow
from bench.support.collection_trial import Trial, TrialSettings
from bench.support.json_log import append_log, read_log
from s2rstore.intervals import Interval, of_units
from s2rtools.data_collection.expected_reduction import Method

SIZES = (15, 30, 60)
COMPARED: tuple[Method, ...] = ("combined", "random", "uniform")
SEEDS = 2
Result = dict[str, float | int | str]
"""One fine-tuning: seed, method, poses, mean and median real error in metres, seconds."""


def figures(seeds: int = SEEDS, settings: TrialSettings | None = None) -> Iterator[BudgetRow]:
    """The mean real error by method and number of poses, and differences of `combined`."""
    results = list(measure(range(seeds), COMPARED, SIZES, settings or TrialSettings()))
    for size in (0, *SIZES):
        for method in COMPARED if size else ("before",):
            errors = [float(r["mean"]) for r in _of(results, method, size)]
            yield BudgetRow(f"collect: real error, {size} poses, {method}", np.mean(errors), "m")
        for other in COMPARED[1:] if size else ():
            gain = paired_gain(results, "combined", other, size)
            name = f"collect: combined better than {other}, {size} poses"
            yield BudgetRow(f"{name} ({gain.low:+.3f} to {gain.high:+.3f})", gain.value, "m")


def measure(
    seeds: Sequence[int],
    methods: Sequence[Method],
    sizes: Sequence[int],
    settings: TrialSettings,
    known: Sequence[Result] = (),
) -> Iterator[Result]:
    """Fine-tune for each seed, method and number of poses that is not `known`."""
    torch.set_num_threads(1)
    done = {(r["seed"], r["method"], r["poses"]) for r in known}
    for seed in seeds:
        trial = Trial(seed, settings)
        wanted = [(m, n) for n in sorted(sizes, reverse=True) for m in methods]
        if (seed, "before", 0) not in done:
            yield _result(seed, "before", 0, trial.errors_before(), 0.0)
        for method, size in wanted:
            if (seed, method, size) in done:
                continue
            began = time.perf_counter()
            errors = trial.errors_after(trial.choose(method, max(sizes))[:size])
            yield _result(seed, method, size, errors, time.perf_counter() - began)


def _result(seed: int, method: str, poses: int, errors: np.ndarray, seconds: float) -> Result:
    return {
        "seed": seed, "method": method, "poses": poses, "mean": round(float(errors.mean()), 4),
        "median": round(float(np.median(errors)), 4), "seconds": round(seconds, 1),
    }  # fmt: skip


def _of(results: Sequence[Result], method: str, size: int) -> list[Result]:
    found = [r for r in results if r["method"] == method and r["poses"] == size]
    return sorted(found, key=lambda r: int(r["seed"]))


def paired_gain(
    results: Sequence[Result], method: str, other: str, size: int, value: str = "mean"
) -> Interval:
    """By how many metres a method's error is below that of another, over the seeds of both."""
    first, second = (
        {int(r["seed"]): float(r[value]) for r in _of(results, each, size)}
        for each in (method, other)
    )
    seeds = sorted(first.keys() & second.keys())
    differences = np.array([second[seed] - first[seed] for seed in seeds])
    return _mean_over_seeds(differences)


def _mean_over_seeds(values: np.ndarray) -> Interval:
    left_out = (values.sum() - values) / max(values.size - 1, 1)
    return of_units(float(values.mean()), left_out, unit="seeds")


def report(results: Sequence[Result]) -> str:
    """Learning curves by method, and paired gains over random and uniform poses."""
    methods = list(dict.fromkeys(str(r["method"]) for r in results if r["poses"]))
    sizes = sorted({int(r["poses"]) for r in results if r["poses"]})
    before = [float(r["mean"]) for r in _of(results, "before", 0)]
    lines = [f"before: mean real error {np.mean(before):.3f} m over {len(before)} seeds"]
    for method in methods:
        curve = []
        for size in sizes:
            errors = np.array([float(r["mean"]) for r in _of(results, method, size)])
            interval = _mean_over_seeds(errors)
            curve.append(
                f"{size}: {interval.value:.3f} ({interval.low:.3f} to {interval.high:.3f}, "
                f"n {errors.size})"
            )
        lines.append(f"{method:9s} " + "  ".join(curve))
    for method in methods:
        for other in ("random", "uniform"):
            if other == method or other not in methods:
                continue
            parts = []
            for size in sizes:
                gain = paired_gain(results, method, other, size)
                parts.append(f"{size}: {gain.value:+.3f} ({gain.low:+.3f} to {gain.high:+.3f})")
            lines.append(f"{method} better than {other} by  " + "  ".join(parts))
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.collect", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--methods", default=",".join(COMPARED))
    parser.add_argument("--sizes", default=",".join(map(str, SIZES)))
    parser.add_argument("--model", default="dataaug", help="pretrained model (default dataaug)")
    parser.add_argument("--layers", choices=("all", "head"), default="all",
                        help="layers that are trained: all, or in seconds those after the "
                        "embedding (default all)")  # fmt: skip
    parser.add_argument("--steps", type=int, default=TrialSettings().steps)
    parser.add_argument("--log", type=Path, help="JSON lines to continue and to append to")
    parser.add_argument("--report", action="store_true", help="only report the log")
    options = parser.parse_args()
    methods = [cast(Method, name) for name in options.methods.split(",")]
    if unknown := set(methods) - set(get_args(Method)):
        parser.error(f"--methods {', '.join(unknown)}: one of {', '.join(get_args(Method))}")
    sizes = [int(size) for size in options.sizes.split(",")]
    known: list[Result] = read_log(options.log) if options.log else []
    if not options.report:
        settings = TrialSettings(options.model, options.steps, layers=options.layers)
        seeds = range(options.first, options.first + options.seeds)
        for result in measure(seeds, methods, sizes, settings, tuple(known)):
            known.append(result)
            print(json.dumps(result), flush=True)
            if options.log is not None:
                append_log(options.log, result)
    print(report(known))
    return 0


if __name__ == "__main__":
    sys.exit(main())
