"""The numbers of the scatter view: the scale of errors, best and worst 15 %, who is larger."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics.top_k import top_k
from s2rtui.analysis.binning import Bins, Bools, Codes, count_selected, selection_indices
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.drawing.scale import Floats, Scale

PERCENT = 15
"""Share of the base population: the worst 15 % of a side are called poor, the best 15 % good."""
LOG_RATIO = 20.0
"""Axes are logarithmic where the largest error is more than this many times a side's median."""
LOG_RULE = f"the largest error is over {LOG_RATIO:g} times the median of a side"
_MARGIN = 1.03
"""Upper end of the axes over the largest error."""
Rank = Literal["best", "worst"]
SIM_LARGER, EQUAL, REAL_LARGER = 1, 2, 3
"""Levels of instances by the larger of their errors; 0 where one is unknown."""


@dataclass(frozen=True, slots=True)
class Quadrant:
    """Instances that are extreme on both sides: `sim` and `real` say at which end."""

    sim: Rank
    real: Rank

    @property
    def name(self) -> str:
        words = {"best": "good", "worst": "poor"}
        if self.sim == self.real:
            return f"{words[self.sim]} in both"
        return f"{words[self.sim]} in sim, {words[self.real]} in real"

    @property
    def expression(self) -> str:
        return f"{self.sim}({PERCENT}%, sim.error) & {self.real}{PERCENT}"


QUADRANTS = (
    Quadrant("worst", "best"), Quadrant("best", "worst"), Quadrant("worst", "worst"),
    Quadrant("best", "best"),
)  # fmt: skip
"""The quadrants; in the first two the sides disagree."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Errors that separate the best and the worst 15 % of a side from the others; NaN for none.

    best: the largest error of the best, worst: the smallest error of the worst.
    """

    best: float
    worst: float


@dataclass(frozen=True, slots=True)
class ScatterSummary:
    """Counts of instances: `total` in view, `selected` of them.

    sim_larger, real_larger: selected instances by side of the diagonal. quadrants: per entry of
    `QUADRANTS` the instances in view and the selected ones. below: instances in view with an error
    below the axis. sim, real: limits of each side.
    """

    total: int
    selected: int
    sim_larger: int
    real_larger: int
    quadrants: tuple[tuple[int, int], ...]
    below: int
    sim: Limits
    real: Limits


def scatter_summary(sim: Floats, real: Floats, selected: Bools, valid: Bools) -> ScatterSummary:
    """Count the instances (N,) by side of the diagonal and by quadrant; errors in metres."""
    selection = selection_indices(selected, valid)
    sides, _ = count_selected(Bins(larger_side(sim, real), 4), selection)
    quadrants = [count_selected(mark, selection) for mark in _quadrant_marks(sim, real, valid)]
    scale = error_scale(sim, real)
    return ScatterSummary(
        total=int(np.count_nonzero(valid)),
        selected=int(sides[1:].sum()),
        sim_larger=int(sides[SIM_LARGER]),
        real_larger=int(sides[REAL_LARGER]),
        quadrants=tuple((int(total[0]), int(chosen[0])) for chosen, total in quadrants),
        below=_number_below(sim, real, valid, scale.low) if scale.log else 0,
        sim=_limits(sim, valid),
        real=_limits(real, valid),
    )


@cached_by_identity(8)
def error_scale(sim: Floats, real: Floats) -> Scale:
    """The axis in metres that holds every known error of both sides (N,).

    Linear from 0, or logarithmic by `LOG_RATIO`; then its lower end is the 1st percentile of the
    errors above 0, rounded down to 1, 2 or 5 times 10^n, where smaller errors are drawn.
    """
    sides = [errors[np.isfinite(errors)] for errors in (sim, real)]
    above = np.concatenate([errors[errors > 0] for errors in sides])
    if not above.size:
        return Scale(0.0, 1.0)
    high = float(above.max()) * _MARGIN
    if above.max() <= LOG_RATIO * min(np.median(errors) for errors in sides if errors.size):
        return Scale(0.0, high)
    return Scale(_rounded_down(float(np.percentile(above, 1))), high, log=True)


def _rounded_down(value: float) -> float:
    """The largest 1, 2 or 5 times 10^n that is not above `value` > 0."""
    power = 10.0 ** math.floor(math.log10(value))
    return max(factor * power for factor in (1, 2, 5) if factor * power <= value * (1 + 1e-9))


@cached_by_identity(8)
def drawn_errors(errors: Floats, scale: Scale) -> NDArray[np.float64]:
    """The errors (N,) as they are drawn: those beyond the axis at its end; NaN stays NaN."""
    return np.clip(np.asarray(errors, dtype=np.float64), scale.low, scale.high)


@cached_by_identity(8)
def larger_side(sim: Floats, real: Floats) -> Codes:
    """Which error (N,) is larger: `SIM_LARGER`, `EQUAL` or `REAL_LARGER`; 0 where unknown."""
    sign = np.sign(np.asarray(real, dtype=np.float64) - sim) + EQUAL
    return np.nan_to_num(sign, nan=0.0).astype(np.uint16)


@cached_by_identity(16)
def extreme(errors: Floats, valid: Bools, rank: Rank) -> Bools:
    """The best or worst 15 % of the valid instances (N,), as the selection language counts them."""
    count = math.ceil(PERCENT * int(np.count_nonzero(valid)) / 100)
    return top_k(np.asarray(errors, dtype=np.float64), valid, count, rank == "worst")


@cached_by_identity(8)
def _limits(errors: Floats, valid: Bools) -> Limits:
    best, worst = (errors[extreme(errors, valid, rank)] for rank in ("best", "worst"))
    return Limits(
        float(best.max()) if best.size else math.nan,
        float(worst.min()) if worst.size else math.nan,
    )


@cached_by_identity(4)
def _quadrant_marks(sim: Floats, real: Floats, valid: Bools) -> tuple[Bins, ...]:
    """One bin for each of `QUADRANTS`: the instances that belong to it."""
    masks = (
        extreme(sim, valid, quadrant.sim) & extreme(real, valid, quadrant.real)
        for quadrant in QUADRANTS
    )
    return tuple(Bins(np.where(mask, 0, 1).astype(np.uint16), 1) for mask in masks)


@cached_by_identity(8)
def _number_below(sim: Floats, real: Floats, valid: Bools, low: float) -> int:
    return int(np.count_nonzero(((sim < low) | (real < low)) & valid))
