"""Figures of runs in reality, by the real images alone and with simulation.

Pairs are the instances with both images that a run was applied to and that are new to it. The
simulated instances are those of which only the sim image was predicted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.index.columns import SideColumns
from s2rstore.intervals import LEVEL, Interval, simulation
from s2rstore.intervals.simulation import Simulated, WithSimulation
from s2rstore.metrics.more_images import (
    POWER,
    MoreImages,
    images_for_width,
    images_to_decide,
)
from s2rstore.metrics.recall import beyond_all, severities, threshold_name, without_lost
from s2rstore.reader import Store

Floats = NDArray[np.float64]
Rows = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure with its name, its unit (`m`, or `%` of a share 0 .. 1), and its intervals."""

    name: str
    unit: str
    estimate: WithSimulation


@dataclass(frozen=True, slots=True, eq=False)
class Images:
    """Iids that count for a figure, in recording order.

    pairs (n,): with both images. simulated (N,): with a sim image alone.
    """

    pairs: Rows
    simulated: Rows


def images_of(
    store: Store, runs: Sequence[str], members: NDArray[np.bool_] | None = None
) -> Images:
    """The instances of some computed runs that are new to all of them.

    With `members` (N,), the pairs are these alone, and no instance is simulated: those there are
    stand for all pairs. Raises RequestError where there are no pairs.
    """
    pairs = np.ones(len(store.instances), dtype=np.bool_) if members is None else members.copy()
    simulated = np.full(len(store.instances), members is None)
    for run in runs:
        columns = store.run_columns(run)
        new = ~columns.trained
        pairs &= columns.attempted & new
        simulated &= ~columns.attempted & new & applied_to(columns.sim)
    if not pairs.any():
        raise RequestError(
            f"{store.path}: no instance with both images is new to {' and '.join(runs)}"
        )
    return Images(store.in_recording_order(pairs), store.in_recording_order(simulated))


def applied_to(side: SideColumns) -> NDArray[np.bool_]:
    """The instances (N,) to whose image of a side a run was applied."""
    return np.asarray((side.split >= 0) | ~np.isnan(side.error))


@dataclass(frozen=True, slots=True, eq=False)
class _Errors:
    """Errors of one run, metres and radians; NaN where an image is not localised."""

    real: Floats
    sim: Floats
    simulated: Floats
    real_heading: Floats
    sim_heading: Floats
    simulated_heading: Floats

    @property
    def localised(self) -> NDArray[np.bool_]:
        """Whether both images of each pair (n,) have a pose."""
        return ~(np.isnan(self.real) | np.isnan(self.sim))

    def severity(self, metres: float, degrees: float) -> tuple[Floats, Floats, Floats]:
        """`recall.severities` of the real, the sim and the simulated images."""
        return (
            severities(self.real, self.real_heading, metres, degrees),
            severities(self.sim, self.sim_heading, metres, degrees),
            severities(self.simulated, self.simulated_heading, metres, degrees),
        )


def _errors(store: Store, run: str, images: Images) -> _Errors:
    columns = store.run_columns(run)
    real, sim = columns.real, columns.sim
    pairs, drawn = images.pairs, images.simulated
    return _Errors(
        real.error[pairs], sim.error[pairs], sim.error[drawn],
        real.heading_error[pairs], sim.heading_error[pairs], sim.heading_error[drawn],
    )  # fmt: skip


def mean_error(store: Store, run: str, images: Images, level: float = LEVEL) -> WithSimulation:
    """The mean error of a run over the localised images."""
    errors, codes = _errors(store, run, images), store.instances.trajectory[images.pairs]
    drawn = store.instances.trajectory[images.simulated]
    known, known_drawn = errors.localised, ~np.isnan(errors.simulated)
    return simulation.mean(
        errors.real[known], errors.sim[known],
        Simulated(errors.simulated[known_drawn], drawn[known_drawn]), codes[known], level=level,
    )  # fmt: skip


def run_figures(store: Store, run: str, images: Images) -> list[Figure]:
    """Mean and median error and recall of a run.

    The mean is over the localised images. Others count as the largest error in the median, and as
    failures in every recall.
    """
    errors, codes = _errors(store, run, images), store.instances.trajectory[images.pairs]
    drawn = store.instances.trajectory[images.simulated]
    found = [
        Figure("mean error", "m", mean_error(store, run, images)),
        Figure("median error", "m", _median(errors, drawn, codes)),
    ]
    for metres, degrees in store.dataset.recall_thresholds:
        real, sim, simulated = errors.severity(metres, degrees)
        hits = Simulated((simulated <= 1).astype(np.float64), drawn)
        share = simulation.proportion(real <= 1, sim <= 1, hits, codes, errors=real)
        found.append(Figure(f"recall ({threshold_name(metres, degrees)})", "%", share))
    return found


def _unknown(value: float, reason: str, codes: NDArray[Any], drawn: NDArray[Any]) -> WithSimulation:
    alone, nothing = Interval.unknown(value, reason), Interval.unknown(reason=reason)
    return WithSimulation(alone, nothing, nothing, nothing, 0.0, codes.size, drawn.size)


def _median(errors: _Errors, drawn: NDArray[Any], codes: NDArray[Any]) -> WithSimulation:
    """The median error; an image without a predicted pose counts as larger than every error."""
    if np.isnan(errors.real).all():
        return _unknown(np.inf, "no image is localised", codes, drawn)
    beyond = beyond_all(errors.sim, errors.simulated)
    sim, simulated = (np.where(np.isnan(x), beyond, x) for x in (errors.sim, errors.simulated))
    real = np.where(np.isnan(errors.real), beyond_all(errors.real), errors.real)
    found = simulation.median(real, sim, Simulated(simulated, drawn), codes)
    largest = float(np.nanmax(errors.real))
    return replace(found, real_only=without_lost(found.real_only, largest),
                   combined=without_lost(found.combined, largest))  # fmt: skip


def difference_figures(store: Store, run: str, other: str, images: Images) -> list[Figure]:
    """Mean error and recall of a run minus those of another, of the same images."""
    one, two = (_errors(store, name, images) for name in (run, other))
    codes = store.instances.trajectory[images.pairs]
    drawn = store.instances.trajectory[images.simulated]
    real, sim, simulated = (
        one.real - two.real, one.sim - two.sim, one.simulated - two.simulated
    )  # fmt: skip
    known, known_drawn = ~(np.isnan(real) | np.isnan(sim)), ~np.isnan(simulated)
    further = Simulated(simulated[known_drawn], drawn[known_drawn])
    mean = simulation.difference(real[known], sim[known], further, codes[known])
    found = [Figure("mean error", "m", mean)]
    for metres, degrees in store.dataset.recall_thresholds:
        a, b, c = (
            (first <= 1).astype(np.float64) - (second <= 1)
            for first, second in zip(one.severity(metres, degrees), two.severity(metres, degrees),
                                     strict=True)
        )  # fmt: skip
        share = (
            simulation.difference(a, b, Simulated(c, drawn), codes)
            if a.any()
            else _unknown(0.0, "both runs are within or beyond it in the same images", codes, drawn)
        )
        found.append(Figure(f"recall ({threshold_name(metres, degrees)})", "%", share))
    return found


@dataclass(frozen=True, slots=True)
class RoomFigure:
    """A room with its `n` localised pairs, and the `share` of further images to take there.

    mean, deviation: of their real errors, in metres. correlation: of real and sim errors. rate: the
    exchange rate of the mean error, unknown of fewer than `simulation.MIN_PAIRS` pairs.
    """

    room: str
    n: int
    mean: float
    deviation: float
    correlation: Interval
    rate: Interval
    share: float


def room_figures(store: Store, run: str, images: Images) -> list[RoomFigure]:
    """The rooms, by the share of further real images that narrows the interval of the mean most.

    The share is that of the pairs times the standard deviation of their real errors. Source:
    Neyman, "On the two different aspects of the representative method", Journal of the Royal
    Statistical Society 97, 1934.
    """
    errors, truth = _errors(store, run, images), store.instances
    known = errors.localised
    room = truth.room[images.pairs]
    found = []
    for code in np.unique(room[known]).tolist():
        rows = known & (room == code)
        real, sim = errors.real[rows], errors.sim[rows]
        codes = truth.trajectory[images.pairs][rows]
        name = truth.room_names[code] if code >= 0 else NO_ROOM
        worth = simulation.mean(real, sim, Simulated.none(), codes)
        found.append(RoomFigure(
            name, real.size, float(real.mean()), float(real.std()), worth.correlation, worth.rate,
            real.size * float(real.std()),
        ))  # fmt: skip
    total = sum(part.share for part in found) or 1.0
    parts = [replace(part, share=part.share / total) for part in found]
    return sorted(parts, key=lambda part: -part.share)


@dataclass(frozen=True, slots=True)
class Plan:
    """How many more real images a mean error needs, with and without simulation.

    what: the goal in words. unlimited: where a simulated image costs nothing.
    """

    what: str
    real_only: MoreImages
    unlimited: MoreImages

    @property
    def text(self) -> str:
        """The plan as a sentence."""
        alone, unlimited = self.real_only, self.unlimited
        if not (alone.images or alone.reason):
            return f"{self.what}: the present images are enough"
        text = f"{self.what}: {alone.text}"
        if unlimited.reason:
            return text
        if not alone.reason and unlimited.images > 0.95 * alone.images:
            return f"{text}; simulated ones save nearly none of them"
        return f"{text}; {unlimited.images:,} beside unlimited simulated ones"

    def as_json(self) -> dict[str, Any]:
        """The plan as JSON data."""
        return {
            "goal": self.what, "real_only": self.real_only.as_json(),
            "with_unlimited_simulation": self.unlimited.as_json(),
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class Evaluation:
    """A run on `pairs` pairs of `trajectories` trajectories and `simulated` further instances.

    `differences`: figures of the run minus those of `other`, empty without one.
    """

    run: str
    other: str | None
    pairs: int
    trajectories: int
    simulated: int
    figures: tuple[Figure, ...]
    differences: tuple[Figure, ...]
    rooms: tuple[RoomFigure, ...]
    plans: tuple[Plan, ...]

    def as_json(self) -> dict[str, Any]:
        """The evaluation as JSON data; shares are 0 .. 1."""
        return {
            "run": self.run, "against": self.other, "pairs": self.pairs,
            "trajectories": self.trajectories, "simulated": self.simulated,
            "figures": {each.name: each.estimate.as_json() for each in self.figures},
            "differences": {each.name: each.estimate.as_json() for each in self.differences},
            "rooms": [
                {"room": each.room, "pairs": each.n, "mean_real_error_m": round(each.mean, 6),
                 "deviation_m": round(each.deviation, 6), "share": round(each.share, 6),
                 "correlation": each.correlation.as_json(), "exchange_rate": each.rate.as_json()}
                for each in self.rooms
            ],
            "plans": [plan.as_json() for plan in self.plans],
        }  # fmt: skip


def evaluate(
    store: Store, run: str, other: str | None = None, target: float | None = None,
    power: float = POWER,
) -> Evaluation:  # fmt: skip
    """Evaluate a computed run, compare it with another, and plan further real images.

    target: half the width of the interval of the mean error, in metres. power: probability with
    which the planned images decide between the runs. Raises RequestError without pairs.
    """
    images = images_of(store, [run])
    figures, plans = run_figures(store, run, images), []
    if target is not None:
        mean = figures[0].estimate
        plans.append(Plan(
            f"mean error within {target:g} m on either side",
            images_for_width(mean.real_only, target),
            images_for_width(mean.real_only, target, mean.rate.value),
        ))  # fmt: skip
    differences: list[Figure] = []
    if other is not None:
        differences = difference_figures(store, run, other, images_of(store, [run, other]))
        mean = differences[0].estimate
        plans.append(Plan(
            f"to decide between {run} and {other} by their mean errors ({100 * power:g} % power)",
            images_to_decide(mean.real_only, power),
            images_to_decide(mean.real_only, power, mean.rate.value),
        ))  # fmt: skip
    return Evaluation(
        run, other, images.pairs.size,
        int(np.unique(store.instances.trajectory[images.pairs]).size), images.simulated.size,
        tuple(figures), tuple(differences), tuple(room_figures(store, run, images)), tuple(plans),
    )  # fmt: skip
