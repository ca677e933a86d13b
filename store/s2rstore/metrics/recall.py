"""Recall of poses within thresholds, median errors, and skill over the mean position.

Recall at (metres, degrees) is the share of instances whose position and heading are both within.
An instance that the run was applied to but did not localise has infinite errors: it counts as a
failure in every recall and median. Source of the thresholds: Sattler et al., "Benchmarking 6DOF
outdoor visual localization in changing conditions", CVPR 2018; here on the scale of rooms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.index.population import NEW_INSTANCES, Population
from s2rstore.intervals import MIN_MEAN, Interval
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import Side

NOT_LOCALISED = "not localised"
Floats = NDArray[np.float64]
Codes = NDArray[np.int32]
Mask = NDArray[np.bool_]


def threshold_name(metres: float, degrees: float) -> str:
    """`1 m, 10 deg`."""
    return f"{metres:g} m, {degrees:g} deg"


@dataclass(frozen=True, slots=True)
class RecallPoint:
    """The share 0 .. 1 of instances within `metres` and `degrees`."""

    metres: float
    degrees: float
    share: Interval

    @property
    def name(self) -> str:
        """`1 m, 10 deg`."""
        return threshold_name(self.metres, self.degrees)


@dataclass(frozen=True, slots=True)
class SideRecall:
    """One side of a run over the `n` instances that it was applied to and that are new to it.

    `not_localised` of these have no pose on this side; `trained_on` instances are left out. The
    medians of `position`, metres, and `heading`, radians, are infinite where half of the instances
    are not localised. `skill` is 1 - mean error / mean error of the mean position, over the
    localised instances: 0 is no better than that constant. All are NaN where n is 0.
    """

    n: int
    not_localised: int
    trained_on: int
    points: tuple[RecallPoint, ...]
    position: Interval
    heading: Interval
    skill: Interval

    @property
    def headline(self) -> RecallPoint:
        """The point that summaries lead with: that of the second largest thresholds."""
        return self.points[headline_index(len(self.points))]

    @property
    def position_text(self) -> str:
        """The median position error: `4.02 m`, or `not localised`."""
        return metres_text(self.position.value)

    @property
    def heading_text(self) -> str:
        """The median heading error: `45.3 deg`, or `not localised`."""
        return degrees_text(self.heading.value)


@dataclass(frozen=True, slots=True)
class Headline:
    """What a line about one side of a run leads with; fields as in `SideRecall`, no intervals.

    `recall` is the share 0 .. 1 at the headline's thresholds, `at`.
    """

    n: int
    not_localised: int
    position: float
    heading: float
    recall: float
    at: str

    @property
    def short(self) -> str:
        """`3.18 m, recall 1 %`; empty without instances."""
        if not self.n:
            return ""
        return f"{metres_text(self.position)}, recall {100 * self.recall:.0f} %"

    @property
    def text(self) -> str:
        """`median 3.18 m, 44.5 deg, recall 1 % (1 m, 10 deg)`, and how many are not localised."""
        if not self.n:
            return "no instance"
        lost = f", {self.not_localised} {NOT_LOCALISED}" if self.not_localised else ""
        return (
            f"median {metres_text(self.position)}, {degrees_text(self.heading)}, "
            f"recall {100 * self.recall:.0f} % ({self.at}){lost}"
        )


def headline_index(count: int) -> int:
    """The second to last of `count` thresholds, or the only one."""
    return max(0, count - 2)


def metres_text(metres: float) -> str:
    """A median position error: `4.02 m`, or `not localised`."""
    return _median_text(metres, f"{metres:.2f} m")


def degrees_text(heading: float) -> str:
    """A median heading error, radians: `45.3 deg`, or `not localised`."""
    return _median_text(heading, f"{math.degrees(heading):.1f} deg")


def _median_text(median: float, text: str) -> str:
    if math.isinf(median):
        return NOT_LOCALISED
    return "n/a" if math.isnan(median) else text


def severities(errors: Floats, heading_errors: Floats, metres: float, degrees: float) -> Floats:
    """(n,) the factor by which both thresholds must grow to hold an instance; inf without a pose.

    `errors` in metres and `heading_errors` in radians, both (n,), NaN where not localised.
    """
    factors = np.maximum(errors / metres, np.degrees(heading_errors) / degrees)
    return np.where(np.isnan(factors), np.inf, factors)


def recall_point(
    errors: Floats, heading_errors: Floats, metres: float, degrees: float, trajectories: Codes
) -> RecallPoint:
    """Recall at one pair of thresholds; arguments as in `severities`, in recording order.

    The interval knows the dependence of the instances from that of their severities, of which
    recall is the share of at most 1.
    """
    factors = severities(errors, heading_errors, metres, degrees)
    share = intervals.proportion(factors <= 1, trajectories, errors=factors)
    return RecallPoint(metres, degrees, share)


def median_error(errors: Floats, trajectories: Codes) -> Interval:
    """Median of `errors` (n,), of which NaN, not localised, counts as larger than any number.

    Median and upper bound are infinite where they lie among these; a lower bound there is the
    largest number, and so is the upper one of `ends`.
    """
    known = errors[~np.isnan(errors)]
    if not known.size:
        value = math.inf if errors.size else math.nan
        return Interval.unknown(value, "no instance is localised" if errors.size else "n 0")
    beyond = beyond_all(errors)
    return without_lost(intervals.median(np.where(np.isnan(errors), beyond, errors), trajectories),
                        float(known.max()))  # fmt: skip


def beyond_all(*errors: Floats) -> float:
    """A number above all errors, which stands for infinite ones: these cannot be interpolated."""
    return 2 * max((float(np.nanmax(each, initial=0.0)) for each in errors), default=0.0) + 1


def without_lost(found: Interval, largest: float) -> Interval:
    """A median in which numbers above the `largest` error stand for images without a pose.

    Median and upper bound are infinite where they lie among these; a lower bound there is the
    largest error, and so is the upper one of `ends`.
    """
    value, high = (math.inf if x > largest else x for x in (found.value, found.high))
    low = min(found.low, largest) if found.is_known else found.low
    ends = found.ends and (found.ends[0], largest)
    return replace(found, low=low, value=value, high=high, ends=ends)


def skill(errors: Floats, constant: Floats, trajectories: Codes) -> Interval:
    """1 - mean of `errors` / mean of `constant`, the errors of a constant prediction; both (n,).

    Instances without an error (NaN) are left out of both means.
    """
    known = ~(np.isnan(errors) | np.isnan(constant))
    errors, constant = errors[known], constant[known]
    mean = float(constant.mean()) if constant.size else 0.0
    if not mean > 0:
        reason = (
            "the constant prediction has no error" if errors.size else "no instance is localised"
        )
        return Interval.unknown(math.nan, reason)
    ratio = intervals.ratio_of_means(errors, constant, trajectories[known], minimum=MIN_MEAN)
    low, value, high = 1 - ratio.high, 1 - ratio.value, 1 - ratio.low
    return replace(ratio, low=low, value=value, high=high)


def side_recall(
    store: Store, run: str, side: Side, members: Mask | None = None,
    population: Population = NEW_INSTANCES,
) -> SideRecall:  # fmt: skip
    """Recall, medians and skill of one side of a computed run, over `members` (N,) or all.

    `population` may hold trained instances.
    """
    columns = store.run_columns(run)
    chosen = columns.attempted if members is None else columns.attempted & members
    keep = population.attempted(store.instances, columns) & chosen
    errors, turns, codes, order = _side_errors(store, run, side, keep)
    limits = store.dataset.recall_thresholds
    return SideRecall(
        n=int(keep.sum()),
        not_localised=int(np.isnan(errors).sum()),
        trained_on=int((chosen & columns.trained & ~keep).sum()),
        points=tuple(recall_point(errors, turns, *pair, codes) for pair in limits),
        position=median_error(errors, codes),
        heading=median_error(turns, codes),
        skill=skill(errors, run_metrics.constant_errors(store, run, side)[order], codes),
    )


def headline(store: Store, run: str, side: Side) -> Headline:
    """The headline of one side of a computed run, without the cost of intervals."""
    columns, pairs = store.run_columns(run), store.dataset.recall_thresholds
    metres, degrees = pairs[headline_index(len(pairs))]
    keep = NEW_INSTANCES.attempted(store.instances, columns)
    errors, turns, _, _ = _side_errors(store, run, side, keep)
    held = severities(errors, turns, metres, degrees) <= 1
    return Headline(
        n=errors.size,
        not_localised=int(np.isnan(errors).sum()),
        position=_middle(errors),
        heading=_middle(turns),
        recall=float(held.mean()) if held.size else math.nan,
        at=threshold_name(metres, degrees),
    )


def _middle(errors: Floats) -> float:
    """The median as in `median_error`."""
    if not errors.size:
        return math.nan
    middle = ((errors.size - 1) // 2, errors.size // 2)
    first, second = np.partition(np.where(np.isnan(errors), np.inf, errors), middle)[list(middle)]
    return float(first + (second - first) / 2) if np.isfinite(second) else math.inf


@dataclass(frozen=True, slots=True, eq=False)
class RecallCurve:
    """Recall at (m, `ratio` m) for every m: the share of `limits` (n,) up to m.

    `limits` ascend, in metres; infinite ones are of instances that are not localised.
    """

    ratio: float
    limits: Floats

    def at(self, metres: Floats) -> Floats:
        """The recall 0 .. 1 at positions `metres` of any shape; NaN without instances."""
        if not self.limits.size:
            return np.full(np.shape(metres), np.nan)
        held = np.searchsorted(self.limits, np.asarray(metres) * (1 + 1e-12), side="right")
        return np.asarray(held / self.limits.size)


def recall_curve(
    store: Store, run: str, side: Side, members: Mask | None = None,
    population: Population = NEW_INSTANCES,
) -> RecallCurve:  # fmt: skip
    """The curve of one side of a computed run, over `members` (N,) or all.

    The degrees per metre are those of the headline's thresholds: of the default ones 10.
    """
    pairs = store.dataset.recall_thresholds
    metres, degrees = pairs[headline_index(len(pairs))]
    columns = store.run_columns(run)
    keep = population.attempted(store.instances, columns)
    errors, turns, _, _ = _side_errors(
        store, run, side, keep if members is None else keep & members
    )
    ratio = degrees / metres
    return RecallCurve(ratio, np.sort(severities(errors, turns, 1.0, ratio)))


def _side_errors(
    store: Store, run: str, side: Side, keep: Mask
) -> tuple[Floats, Floats, Codes, NDArray[np.intp]]:
    """Errors, heading errors, trajectories and iids of the instances of `keep` in order."""
    part, order = store.run_columns(run).side(side), store.in_recording_order(keep)
    return (part.error[order], part.heading_error[order], store.instances.trajectory[order], order)
