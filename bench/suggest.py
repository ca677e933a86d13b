"""Suggestions in generated worlds of one factor, whose cause is known, and of none."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.budget import BudgetRow
from bench.measured_stores import QUIET, lively
from s2rstore.geometry.camera_offset import FOV, HEIGHT, PITCH
from s2rstore.index.transaction import edit
from s2rtools.datasets import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from s2rtools.datasets.writing.build import build
from s2rtools.models.model_registration import pack_weights, register_model
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import insert_run
from s2rtools.suggestions import SuggestSettings, suggest
from s2rtools.suggestions.answers import SuggestReport
from s2rtools.synthetic_world.factors import parse_factors

FACTORS = ("lights", "exposure", "camera", "depth")
SEEDS = 10
_NULL_SEEDS = 20
_INSTANCES = 24
"""Instances of each of the two trajectories."""
_FRAMES, _EVALUATIONS = 12, 40
_PIXELS = 64
_RUN = "measured"


@dataclass(frozen=True, slots=True)
class Found:
    """What a search found in a world: the factor named first, values by name, and the truth."""

    helps: bool
    factor: str | None
    values: dict[str, float]
    truth: dict[str, float]
    evaluations: int
    seconds: float


def figures(seeds: int) -> Iterator[BudgetRow]:
    """Shares of the seeds in which the factor is named first; errors of the camera; false alarms.

    Each seed is another building with another severity between 0.6 and 1.4; the real camera is also
    pitched by up to 3 degrees where the factor is `camera`. The network has random weights, because
    the search compares images. Worlds without factor have twice as many seeds.
    """
    for factor in FACTORS:
        found = [find(factor, seed) for seed in range(1, seeds + 1)]
        right = sum(each.factor == factor for each in found)
        name = f"suggest: {factor} named first, of {seeds} worlds"
        yield BudgetRow(name, right / seeds, "share", 0.9, "at least")
        if factor == "camera":
            yield from _camera_rows(found)
        evaluations = [each.evaluations for each in found]
        yield BudgetRow(f"suggest: evaluations, {factor}", float(np.median(evaluations)), "")
    number = _NULL_SEEDS * seeds // SEEDS
    false = sum(find("none", seed).helps for seed in range(1, number + 1))
    yield BudgetRow(f"suggest: false suggestions in {number} worlds", false, "", 0.0)


def _camera_rows(found: list[Found]) -> Iterator[BudgetRow]:
    for name, unit, scale, budget in (
        (HEIGHT, "cm", 100.0, 2.0), (PITCH, "degrees", 1.0, 1.0), (FOV, "degrees", 1.0, None),
    ):  # fmt: skip
        errors = [abs(each.values.get(name, 0.0) - each.truth[name]) for each in found]
        yield BudgetRow(f"suggest: largest error of {name}", scale * max(errors), unit, budget)


def find(factor: str, seed: int) -> Found:
    """Build the world of a factor (or `none`) and a seed, and tune its simulator."""
    rng = np.random.default_rng([seed, len(factor)])
    severity, pitch = rng.uniform(0.6, 1.4), round(float(rng.uniform(-3, 3)), 2)
    factors = "none" if factor == "none" else f"{factor}={severity:.3f}"
    folder = Path(tempfile.mkdtemp())
    try:
        path = _world(folder / "world.s2r", seed, factors, pitch if factor == "camera" else 0.0)
        began = time.perf_counter()
        settings = SuggestSettings(
            "sim", budget=1e6, frames=_FRAMES, evaluations=_EVALUATIONS, changes=3, seed=seed
        )
        report = suggest(path, _RUN, settings, QUIET)
        return _found(report, time.perf_counter() - began)
    finally:
        shutil.rmtree(folder)


def _found(report: SuggestReport, seconds: float) -> Found:
    if report.best is None:
        return Found(False, None, {}, report.truth, report.evaluations, seconds)
    answer = report.answers[report.best]
    values = {change.name: change.value for change in answer.changes}
    return Found(True, answer.factor, values, report.truth, report.evaluations, seconds)


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
