"""Suggestions in generated worlds of one factor, whose cause is known, and of none.

`python -m bench.suggest --log FILE --factors lights,exposure,camera,depth,none --seeds 10` measures
the worlds that the log does not hold yet, appends one line to the log for each, and prints a report
of all of them. Worlds without a factor (`none`) have twice as many seeds.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from bench.budget import BudgetRow
from bench.measured_stores import QUIET, lively
from bench.support.json_log import append_log, read_log
from s2rstore.geometry.camera_offset import FOV, HEIGHT, PITCH
from s2rstore.index.transaction import edit
from s2rstore.suggestions import SuggestReport
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.models.model_registration import pack_weights, register_model
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import insert_run
from s2rtools.suggestions.settings import SuggestSettings
from s2rtools.suggestions.suggest import suggest
from s2rtools.synthetic_world.factors import parse_factors

FACTORS = ("lights", "exposure", "camera", "depth")
SEEDS = 10
_NULL_RATIO = 2
"""Worlds without a factor for each world of a factor."""
_INSTANCES = 24
"""Instances of each of the two trajectories."""
_FRAMES, _EVALUATIONS = 12, 40
_PIXELS = 64
_RUN = "measured"


NONE = "none"
_CAMERA = ((HEIGHT, "cm", 100.0, 2.0), (PITCH, "degrees", 1.0, 1.0), (FOV, "degrees", 1.0, None))
"""Values of the camera: name, unit of the report, its scale, and the largest error allowed."""


@dataclass(frozen=True, slots=True)
class World:
    """What a search found in the world of a factor (or `none`) and a seed.

    named: the factor named first, None where nothing helps. values: fitted ones, and truth: true
    ones, by adjustment, in metres and degrees.
    """

    factor: str
    seed: int
    named: str | None
    values: dict[str, float]
    truth: dict[str, float]
    evaluations: int
    seconds: float

    @property
    def right(self) -> bool:
        """Whether the answer is the world's factor, or nothing in a world without one."""
        return self.named == (None if self.factor == NONE else self.factor)

    def error(self, name: str) -> float:
        """Distance of a fitted value of the camera from the true one; unchanged ones count as 0."""
        return abs(self.values.get(name, 0.0) - self.truth[name])


def figures(seeds: int) -> Iterator[BudgetRow]:
    """Shares of the seeds in which the factor is named first; errors of the camera; false alarms.

    Each seed is another building with another severity between 0.6 and 1.4; the real camera is also
    pitched by up to 3 degrees where the factor is `camera`. The network has random weights, because
    the search compares images. Worlds without factor have twice as many seeds.
    """
    worlds = list(measure((*FACTORS, NONE), seeds))
    for factor in FACTORS:
        found = of_factor(worlds, factor)
        name = f"suggest: {factor} named first, of {len(found)} worlds"
        yield BudgetRow(name, _right(found) / len(found), "share", 0.9, "at least")
        if factor == "camera":
            for name, unit, scale, budget in _CAMERA:
                largest = scale * max(world.error(name) for world in found)
                yield BudgetRow(f"suggest: largest error of {name}", largest, unit, budget)
        evaluations = [world.evaluations for world in found]
        yield BudgetRow(f"suggest: evaluations, {factor}", float(np.median(evaluations)), "")
    found = of_factor(worlds, NONE)
    false = len(found) - _right(found)
    yield BudgetRow(f"suggest: false suggestions in {len(found)} worlds", false, "", 0.0)


def measure(
    factors: Sequence[str], seeds: int, known: Sequence[World] = (), first: int = 1
) -> Iterator[World]:
    """Search in the worlds of `factors` that are not `known`, seed by seed from `first` on."""
    done = {(world.factor, world.seed) for world in known}
    for seed in range(first, first + _NULL_RATIO * seeds):
        for factor in factors:
            wanted = factor == NONE or seed < first + seeds
            if wanted and (factor, seed) not in done:
                yield find(factor, seed)


def of_factor(worlds: Sequence[World], factor: str) -> list[World]:
    """The worlds of a factor, by seed."""
    return sorted((w for w in worlds if w.factor == factor), key=lambda world: world.seed)


def _right(worlds: Sequence[World]) -> int:
    return sum(world.right for world in worlds)


def report(worlds: Sequence[World]) -> str:
    """Worlds whose factor is named first, errors of the camera, and false suggestions."""
    lines = []
    for factor in dict.fromkeys(world.factor for world in worlds):
        found = of_factor(worlds, factor)
        right, n = _right(found), len(found)
        others = Counter(world.named or "nothing" for world in found if not world.right)
        wrong = ", ".join(f"{name} {number}" for name, number in others.most_common())
        if factor == NONE:
            head = f"none: false suggestions in {n - right} of {n} worlds"
        else:
            head = f"{factor}: named first in {right} of {n} worlds ({100 * right / n:.0f} %)"
        median = np.median([world.seconds for world in found])
        evaluations = np.median([world.evaluations for world in found])
        lines.append(
            f"{head}{f'; instead: {wrong}' if wrong else ''}; "
            f"median {evaluations:.0f} evaluations, {median:.0f} s"
        )
        if factor == "camera":
            lines += [_error_line(found, name, unit, scale) for name, unit, scale, _ in _CAMERA]
    return "\n".join(lines)


def _error_line(worlds: Sequence[World], name: str, unit: str, scale: float) -> str:
    errors = np.array([scale * world.error(name) for world in worlds])
    worst = worlds[int(np.argmax(errors))].seed
    return (
        f"  error of {name}: largest {errors.max():.2f} {unit} (seed {worst}), "
        f"median {np.median(errors):.2f} {unit}, n {errors.size}"
    )


def find(factor: str, seed: int) -> World:
    """Build the world of a factor (or `none`) and a seed, and tune its simulator."""
    rng = np.random.default_rng([seed, len(factor)])
    severity, pitch = rng.uniform(0.6, 1.4), round(float(rng.uniform(-3, 3)), 2)
    factors = NONE if factor == NONE else f"{factor}={severity:.3f}"
    folder = Path(tempfile.mkdtemp())
    try:
        path = _world(folder / "world.s2r", seed, factors, pitch if factor == "camera" else 0.0)
        began = time.perf_counter()
        settings = SuggestSettings(
            "sim", budget=1e6, frames=_FRAMES, evaluations=_EVALUATIONS, changes=3, seed=seed
        )
        made = suggest(path, _RUN, settings, QUIET)
        return _found(factor, seed, made, time.perf_counter() - began)
    finally:
        shutil.rmtree(folder)


def _found(factor: str, seed: int, made: SuggestReport, seconds: float) -> World:
    named, values = None, {}
    if made.best is not None:
        answer = made.answers[made.best]
        named = answer.factor
        values = {change.name: change.value for change in answer.changes}
    return World(factor, seed, named, values, made.truth, made.evaluations, round(seconds, 1))


def _world(path: Path, seed: int, factors: str, pitch: float) -> Path:
    """A world with a computed run of an untrained network; the real camera is pitched up."""
    world = {"seed": seed, "count": _INSTANCES, "survey": 0, "factors": parse_factors(factors)}
    scan = IMPORTERS["world"](Path(), ScanOptions(frame=(_PIXELS, _PIXELS), world=world))
    build(scan, path, "bench", False, lambda steps: None)
    network = lively("resposenet")
    chain = [{"name": PITCH, "value": pitch}] if pitch else []
    with edit(path) as draft:
        register_model(path, draft, "random", pack_weights(network), network.convention)
        insert_run(draft, _RUN, "random", ("sim", "real"), {"sim": [], "real": chain})
    precompute(path, QUIET, [_RUN], PrecomputeOptions((), workers=1, backend="torch"))
    return path


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.suggest", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="worlds of each factor")
    parser.add_argument("--first", type=int, default=1, help="the first seed (default 1)")
    parser.add_argument("--factors", default=",".join((*FACTORS, NONE)))
    parser.add_argument("--log", type=Path, help="JSON lines to continue and to append to")
    parser.add_argument("--report", action="store_true", help="only report the log")
    options = parser.parse_args()
    factors = options.factors.split(",")
    if unknown := set(factors) - {*FACTORS, NONE}:
        parser.error(f"--factors {', '.join(unknown)}: one of {', '.join((*FACTORS, NONE))}")
    rows: list[dict[str, Any]] = read_log(options.log) if options.log else []
    worlds = [World(**row) for row in rows]
    if not options.report:
        torch.set_num_threads(1)
        for world in measure(factors, options.seeds, tuple(worlds), options.first):
            worlds.append(world)
            print(json.dumps(asdict(world)), flush=True)
            if options.log:
                append_log(options.log, asdict(world))
    print(report(worlds))
    return 0


if __name__ == "__main__":
    sys.exit(main())
