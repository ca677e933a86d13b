"""Intervals with simulation in buildings of the synthetic world that no model has seen.

In each building 50 drives of 100 poses are rendered on both sides. The truth of a run is its figure
over all 5,000 real images. A study takes 100 to 400 consecutive real images of 2 to 12 drives, and
the sim images of all other poses. A row counts the studies of all buildings and sizes. The realised
exchange rate of one building and size is the variance of the real estimates in that of the
estimates with simulation; predicted and realised rates are compared by their geometric means. The
least coverage allows for the spread between buildings, whose studies share their drives.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bench.budget import BudgetRow
from bench.exchange import LIMIT, WIDEST
from bench.support.collection_trial import Poses, Trial, TrialSettings, pretrained_model
from s2rstore.intervals import simulation
from s2rstore.intervals.simulation import Simulated, WithSimulation
from s2rtools.synthetic_world.routes import drive_along
from s2rtools.training.evaluation import pose_errors, predict
from s2rtools.training.pretrained import PRETRAINED_MODELS

BUILDINGS = tuple(range(2, 22))
DRIVES, LENGTH = 50, 100
SIZES = ((100, 2), (100, 4), (200, 5), (200, 2), (400, 10), (384, 12))
"""Real images of a study and the drives that they come from."""
REPEATS = 40
"""Studies of one size in one building."""
RATE_DIFFERENCE = 0.15
"""Largest distance of the predicted from the realised exchange rate, in the realised one."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class BuildingErrors:
    """Position errors in metres of each run, (2, DRIVES, LENGTH): the real and the sim images."""

    building: int
    errors: dict[str, Floats]


def building_errors(building: int) -> BuildingErrors:
    """Render both sides of all drives and predict them with the pretrained models."""
    trial = Trial(0, TrialSettings(building=building))
    poses = np.concatenate([_drive(trial, number) for number in range(DRIVES)])
    rows = np.arange(len(poses))
    models = {name: pretrained_model(name) for name in PRETRAINED_MODELS}
    errors: dict[str, list[Floats]] = {name: [] for name in models}
    for side in ("real", "sim"):
        frames = trial.frames(side, poses, 40_000)
        for name, model in models.items():
            predicted = predict(model.network, model.convention, frames, rows)
            errors[name].append(pose_errors(predicted, poses)[0].reshape(DRIVES, LENGTH))
    return BuildingErrors(building, {name: np.stack(sides) for name, sides in errors.items()})


def _drive(trial: Trial, number: int) -> Poses:
    """The first LENGTH poses of a drive through stops in random rooms."""
    rng = np.random.default_rng([trial.settings.building, number])
    rooms = [room.area for room in trial.world.plan.rooms]
    while True:
        stops = [
            (rng.uniform(area.x0 + 0.5, area.x1 - 0.5), rng.uniform(area.y0 + 0.5, area.y1 - 0.5))
            for area in (rooms[k] for k in rng.permutation(len(rooms)))
        ]
        line = trial.world.floor.route(stops)
        if not len(line):  # a stop is not reachable
            continue
        poses = drive_along(line, rng, LENGTH + 20, trial.world.has_content)
        if len(poses) >= LENGTH:
            return poses[:LENGTH]


@dataclass(slots=True)
class _Tally:
    """Studies of one figure of one run, by building and size."""

    hits: list[bool] = field(default_factory=list)
    buildings: list[int] = field(default_factory=list)
    alone_hits: list[bool] = field(default_factory=list)
    widths: list[float] = field(default_factory=list)
    rates: dict[tuple[int, int, int], list[WithSimulation]] = field(
        default_factory=lambda: defaultdict(list)
    )
    refused: int = 0


def figures(buildings: Iterable[BuildingErrors] | None = None) -> Iterator[BudgetRow]:
    """Coverage, width and exchange rate of each run, and of the difference of two."""
    tallies: dict[str, _Tally] = defaultdict(_Tally)
    for building in map(building_errors, BUILDINGS) if buildings is None else buildings:
        _add(tallies, building)
    for title, tally in tallies.items():
        studies, places = len(tally.hits), np.array(tally.buildings)
        shares = [float(np.mean(np.array(tally.hits)[places == each])) for each in set(places)]
        noise = float(np.std(shares, ddof=1)) / math.sqrt(len(shares)) if len(shares) > 1 else 0.0
        yield BudgetRow(
            f"{title}: coverage", float(np.mean(tally.hits)), "coverage", LIMIT - noise, "at least",
            {"real_only": float(np.mean(tally.alone_hits)), "studies": studies,
             "refused": tally.refused / (studies + tally.refused)},
        )  # fmt: skip
        yield BudgetRow(f"{title}: width", float(np.mean(tally.widths)), "ratio", WIDEST)
        predicted, realised = _rates(tally)
        yield BudgetRow(
            f"{title}: exchange rate, predicted against realised",
            abs(predicted / realised - 1), "share", RATE_DIFFERENCE,
            details={"predicted": predicted, "realised": realised},
        )  # fmt: skip


def _add(tallies: dict[str, _Tally], building: BuildingErrors) -> None:
    rng = np.random.default_rng(building.building)
    for images, drives in SIZES:
        for _ in range(REPEATS):
            taken = _stretches(rng, images, drives)
            for title, (estimate, truth) in _quantities(building, taken).items():
                tally, found = tallies[title], estimate()
                if not found.combined.is_known:
                    tally.refused += 1
                    continue
                alone, both = found.real_only, found.combined
                tally.buildings.append(building.building)
                tally.hits.append(both.low <= truth <= both.high)
                tally.alone_hits.append(alone.low <= truth <= alone.high)
                if 0 < alone.high - alone.low < math.inf:
                    tally.widths.append((both.high - both.low) / (alone.high - alone.low))
                tally.rates[building.building, images, drives].append(found)


def _stretches(rng: np.random.Generator, images: int, drives: int) -> NDArray[np.bool_]:
    """The images of a study (DRIVES, LENGTH): as many consecutive ones of each of some drives."""
    taken = np.zeros((DRIVES, LENGTH), bool)
    each = images // drives
    for drive in rng.choice(DRIVES, drives, replace=False):
        first = rng.integers(0, LENGTH - each + 1)
        taken[drive, first : first + each] = True
    return taken


def _quantities(
    building: BuildingErrors, taken: NDArray[np.bool_]
) -> dict[str, tuple[Callable[[], WithSimulation], float]]:
    """An estimate of each figure from the images of a study, and its true value."""
    drives = np.broadcast_to(np.arange(DRIVES)[:, None], taken.shape)
    codes, others = drives[taken], drives[~taken]
    found: dict[str, tuple[Callable[[], WithSimulation], float]] = {}
    for name, (real, sim) in building.errors.items():
        simulated = Simulated(sim[~taken], others)
        limit = float(np.median(real))
        hits = Simulated((sim[~taken] < limit).astype(np.float64), others)
        found[f"{name}, mean"] = (
            partial(simulation.mean, real[taken], sim[taken], simulated, codes),
            float(real.mean()),
        )
        found[f"{name}, median"] = (
            partial(simulation.median, real[taken], sim[taken], simulated, codes),
            limit,
        )
        found[f"{name}, share below the median"] = (
            partial(
                simulation.proportion,
                real[taken] < limit,
                sim[taken] < limit,
                hits,
                codes,
                errors=real[taken],
            ),
            float(np.mean(real < limit)),
        )
    base, other = (building.errors[name] for name in ("vanilla", "finetune"))
    real, sim = other - base
    found["finetune - vanilla, mean"] = (
        partial(
            simulation.difference, real[taken], sim[taken], Simulated(sim[~taken], others), codes
        ),
        float(real.mean()),
    )
    return found


def _rates(tally: _Tally) -> tuple[float, float]:
    """Geometric means of the predicted and of the realised exchange rates."""
    predicted, realised = [], []
    for studies in tally.rates.values():
        alone, both = (
            np.var([getattr(each, name).value for each in studies])
            for name in ("real_only", "combined")
        )
        known = [each.rate.value for each in studies if math.isfinite(each.rate.value)]
        if known and both > 0:
            predicted.append(math.log(float(np.median(known))))
            realised.append(math.log(float(alone / both)))
    return math.exp(np.mean(predicted)), math.exp(np.mean(realised))
