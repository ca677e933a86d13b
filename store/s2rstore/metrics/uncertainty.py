"""How good a predicted sigma is: calibration, risk by coverage, and conformal radii.

Sigma is the standard deviation of a predicted position per axis, metres, as the network states it.

- Calibration: under an isotropic Gaussian the error of a position has Rayleigh's distribution, so
  that P(error <= sigma sqrt(-2 ln(1 - p))) = p.
- Risk by coverage: the mean error of the instances with the smallest sigmas, and its mean over all
  coverages, AURC. Source: Geifman, Uziel and El-Yaniv, "Bias-reduced uncertainty estimation for
  deep neural classifiers", ICLR 2019.
- Conformal radius: hierarchical conformal prediction, which takes units (visits or trajectories),
  not images, as exchangeable. Source: Lee, Barber and Willett, "Distribution-free inference with
  hierarchical data", arXiv 2306.06342, 2023; one radius per room (Mondrian): Vovk, Gammerman and
  Shafer, "Algorithmic learning in a random world", 2005.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.index.population import NEW_INSTANCES, Population
from s2rstore.intervals import Interval
from s2rstore.reader import Store
from s2rstore.records import Side

PROBABILITIES = (0.5, 0.68, 0.8, 0.9, 0.95)
"""Probabilities p at which calibration is measured."""
COVERAGES = (0.1, 0.25, 0.5, 0.75, 0.9, 1.0)
"""Shares of the instances, the most certain first, whose mean error is given."""
ALPHA = 0.1
"""A radius holds with probability 1 - `ALPHA`."""
NO_SIGMA = "no sigma: the predictions carry none"
WHOLE = "all rooms"
"""What the radius over all instances is called in place of a room."""
Unit = Literal["visit", "trajectory"]
"""What is exchangeable: a stay in one room without a break, or a trajectory."""
PLURALS: dict[Unit, str] = {"visit": "visits", "trajectory": "trajectories"}
_TOLERANCE = 1e-9
Floats = NDArray[np.float64]
Codes = NDArray[np.integer[Any]]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class CalibrationPoint:
    """The observed share of errors within the radius of probability `p`, which should be `p`."""

    p: float
    share: Interval


@dataclass(frozen=True, slots=True)
class Calibration:
    """Observed shares at `PROBABILITIES`, and the factor of sigma that fits the median error.

    A factor above 1 says that the stated sigmas are too small.
    """

    points: tuple[CalibrationPoint, ...]
    factor: Interval


@dataclass(frozen=True, slots=True)
class RiskCoverage:
    """`risks`, the mean errors in metres at `COVERAGES`, and the areas under the curves, metres.

    `ideal` are the risks where the order is that of the errors.

    `aurc` is the mean of the risks at all coverages 1/n .. 1, `optimal` that of the order by error,
    and `random` that of a random order, the mean error.
    """

    risks: tuple[float, ...]
    ideal: tuple[float, ...]
    aurc: float
    optimal: float
    random: float


@dataclass(frozen=True, slots=True)
class Radius:
    """The radius that holds a further value with probability 1 - `ALPHA`, or the reason for none.

    `value` is in the unit of the values, NaN without a radius. It rests on `n` values in `count`
    units of the kind `unit`.
    """

    value: float
    n: int
    count: int
    unit: Unit
    reason: str = ""


@dataclass(frozen=True, slots=True)
class RoomRadius:
    """The radius of a room or of `WHOLE`: of errors in metres, and of errors in sigmas.

    `in_sigmas` is None where no instance has a sigma.
    """

    room: str
    metres: Radius
    in_sigmas: Radius | None


@dataclass(frozen=True, slots=True)
class SideUncertainty:
    """One side of a run over the `n` instances that it was applied to and that are new to it.

    `not_localised` of them have no pose; their errors are infinite in the radii in metres.
    `with_sigma` are localised and have a sigma; all figures of sigma are over these. Without any,
    `calibration` and `risk` are None, for a `reason`.
    """

    n: int
    not_localised: int
    with_sigma: int
    calibration: Calibration | None
    risk: RiskCoverage | None
    radii: tuple[RoomRadius, ...]
    reason: str


def expected_ratio(p: float) -> float:
    """The error in sigmas within which an isotropic Gaussian lies with probability `p`."""
    return math.sqrt(-2 * math.log1p(-p))


def calibration(errors: Floats, sigmas: Floats, trajectories: Codes) -> Calibration:
    """Compare `errors` with the radii that follow from `sigmas`.

    All (n,), in recording order; errors and sigmas in metres. Raises ValueError for other
    shapes, NaN, and sigmas that are not finite and above 0.
    """
    ratios = _ratios(errors, sigmas)
    points = (
        CalibrationPoint(
            p, intervals.proportion(ratios <= expected_ratio(p), trajectories, errors=ratios)
        )
        for p in PROBABILITIES
    )
    factor = intervals.median(ratios, trajectories).scaled(1 / expected_ratio(0.5))
    return Calibration(tuple(points), factor)


def risk_coverage(errors: Floats, sigmas: Floats) -> RiskCoverage:
    """Mean errors of the most certain instances; arguments as of `calibration`.

    Instances of equal sigma have no order: the figures are the means over all their orders. A share
    of the instances is rounded up to a whole number.
    """
    _ratios(errors, sigmas)
    n = errors.size
    if not n:
        unknown = (math.nan,) * len(COVERAGES)
        return RiskCoverage(unknown, unknown, math.nan, math.nan, math.nan)
    risks, ideal = _risks(errors, sigmas), _risks(errors, errors)
    counts = [math.ceil(share * n - _TOLERANCE) for share in COVERAGES]
    return RiskCoverage(
        tuple(float(risks[count - 1]) for count in counts),
        tuple(float(ideal[count - 1]) for count in counts),
        float(risks.mean()),
        float(ideal.mean()),
        float(errors.mean()),
    )


def conformal_radius(
    values: Floats, units: Codes, unit: Unit = "visit", alpha: float = ALPHA
) -> Radius:
    """The smallest radius within which a value of a further unit lies with probability 1 - alpha.

    `values` (n,), such as errors in metres, infinite where not localised; `units` (n,) are codes.
    Each of the K units has the weight 1 / (K + 1), shared by its values; the rest lies at infinity.
    This holds where the further unit is exchangeable with these, whatever the dependence of the
    values inside a unit. It needs K >= 1 / alpha - 1. Raises ValueError for NaN and other shapes.
    """
    if values.shape != units.shape or np.isnan(values).any():
        raise ValueError("values and units must have one shape, and values must not be NaN")
    _, codes, sizes = np.unique(units, return_inverse=True, return_counts=True)
    count, needed = sizes.size, math.ceil(1 / alpha - 1 - _TOLERANCE)
    if count < needed:
        named = unit if count == 1 else PLURALS[unit]
        reason = f"no radius: {count} {named}, {needed} are needed"
        return Radius(math.nan, values.size, count, unit, reason)
    order = np.argsort(values, kind="stable")
    weights = np.cumsum(1 / sizes[codes[order]])  # in units of 1 / (K + 1)
    place = int(np.searchsorted(weights, (1 - alpha) * (count + 1) - _TOLERANCE))
    radius = float(values[order[min(place, values.size - 1)]])
    if math.isinf(radius):
        reason = "no radius: too many instances are not localised"
        return Radius(math.nan, values.size, count, unit, reason)
    return Radius(radius, values.size, count, unit)


def visit_codes(trajectories: Codes, rooms: Codes) -> Codes:
    """(n,) numbers of the visits: stays in one room without a break, within one trajectory.

    Both (n,), of all instances in recording order.
    """
    begins = np.zeros(trajectories.size, dtype=np.bool_)
    begins[1:] = (np.diff(trajectories) != 0) | (np.diff(rooms) != 0)
    return np.asarray(np.cumsum(begins))


def side_uncertainty(
    store: Store, run: str, side: Side, members: Mask | None = None,
    population: Population = NEW_INSTANCES,
) -> SideUncertainty:  # fmt: skip
    """Calibration, risk and radii of one side of a computed run.

    They are over the instances of the population in `members` (N,) bool, by default all of it. The
    units of the radius over all rooms are trajectories where there are enough of them, else
    visits. A sigma that is no number above 0 counts as none.
    """
    columns, truth = store.run_columns(run), store.instances
    keep = population.attempted(truth, columns)
    keep = keep if members is None else keep & members
    part = columns.side(side)
    everything = store.in_recording_order(np.ones(len(truth), dtype=np.bool_))
    order = everything[keep[everything]]
    trajectories, rooms = truth.trajectory[order], truth.room[order]
    visits = visit_codes(truth.trajectory[everything], truth.room[everything])[keep[everything]]
    errors, sigmas = part.error[order], part.sigma[order]
    stated = np.isfinite(errors) & np.isfinite(sigmas) & (sigmas > 0)
    has_sigma = bool(stated.any())
    figures = errors[stated], sigmas[stated]
    limits = np.where(np.isnan(errors), np.inf, errors)

    def radius(chosen: Mask, name: str, units: Codes, unit: Unit) -> RoomRadius:
        known = chosen & stated
        scaled = conformal_radius(errors[known] / sigmas[known], units[known], unit)
        metres = conformal_radius(limits[chosen], units[chosen], unit)
        return RoomRadius(name, metres, scaled if has_sigma else None)

    whole = np.ones(order.size, dtype=np.bool_)
    is_enough = np.unique(trajectories).size >= math.ceil(1 / ALPHA - 1 - _TOLERANCE)
    units: tuple[Codes, Unit] = (trajectories, "trajectory") if is_enough else (visits, "visit")
    return SideUncertainty(
        n=order.size,
        not_localised=int(np.isnan(errors).sum()),
        with_sigma=int(stated.sum()),
        calibration=calibration(*figures, trajectories[stated]) if has_sigma else None,
        risk=risk_coverage(*figures) if has_sigma else None,
        radii=(
            radius(whole, WHOLE, *units),
            *(radius(inside, name, visits, "visit")
              for name, inside in _rooms(rooms, truth.room_names)),
        ),
        reason="" if has_sigma else NO_SIGMA if order.size else "n 0",
    )  # fmt: skip


def _rooms(rooms: Codes, names: tuple[str, ...]) -> Iterator[tuple[str, Mask]]:
    """The name and the instances of each room that has any; `NO_ROOM` is last."""
    for code in (*range(len(names)), -1):
        inside = rooms == code
        if inside.any():
            yield names[code] if code >= 0 else NO_ROOM, np.asarray(inside)


def _risks(errors: Floats, sigmas: Floats) -> Floats:
    """(n,) mean errors of the 1 .. n instances with the smallest sigmas, over orders of equals."""
    _, codes, sizes = np.unique(sigmas, return_inverse=True, return_counts=True)
    means = np.bincount(codes, errors) / sizes
    return np.asarray(np.cumsum(np.repeat(means, sizes)) / np.arange(1, errors.size + 1))


def _ratios(errors: Floats, sigmas: Floats) -> Floats:
    """Errors in sigmas (n,). Raises ValueError as `calibration`."""
    if (
        errors.shape != sigmas.shape
        or np.isnan(errors).any()
        or not ((sigmas > 0) & (sigmas < np.inf)).all()
    ):
        raise ValueError(
            "errors and sigmas must be numbers of one shape, and sigmas finite and above 0"
        )
    return np.asarray(errors / sigmas)
