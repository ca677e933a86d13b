"""How many more real images an interval needs, from the interval of those there are.

Further images come in visits like the present ones, so that the variance of an estimate falls as
one over the number of images. Simulation divides the images by the exchange rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from scipy import special

from s2rstore.intervals import FEWEST_TRAJECTORIES, Interval
from s2rstore.intervals.dependence import series_freedom

POWER = 0.8
MOST = 50.0
"""Most images that are planned, in present ones: beyond, the present images say too little."""
_STEPS = 60


@dataclass(frozen=True, slots=True)
class MoreImages:
    """Further real images, in further visits; a `reason` where their number is not known.

    visits: 0 where the estimate is about the present trajectories alone.
    """

    images: int
    visits: int
    reason: str = ""

    @property
    def text(self) -> str:
        """`74 more real images in 2 more visits`."""
        if self.reason:
            return self.reason
        text = f"{self.images:,} more real image{'' if self.images == 1 else 's'}"
        if not self.visits:
            return text
        return f"{text} in {self.visits} more visit{'' if self.visits == 1 else 's'}"

    def as_json(self) -> dict[str, Any]:
        """The number as JSON data; null where it is not known."""
        known = not self.reason
        return {"images": self.images if known else None, "visits": self.visits if known else None,
                "reason": self.reason or None}  # fmt: skip


def images_for_width(interval: Interval, most: float, rate: float = 1.0) -> MoreImages:
    """Images for an interval of at most `most` on either side, with a probability of one half.

    `rate`: the exchange rate of unlimited simulated images beside them.
    """
    return _smallest(interval, rate, lambda factor: half_width(interval, factor, rate) <= most)


def images_to_decide(interval: Interval, power: float = POWER, rate: float = 1.0) -> MoreImages:
    """Images after which the interval of a difference excludes 0 with the probability `power`.

    The probability is about all images together, and over the differences that the present images
    leave possible (predictive power, with no prior knowledge of the difference). Source:
    Spiegelhalter, Freedman and Blackburn, "Monitoring clinical trials: conditional or predictive
    power?", Controlled Clinical Trials 7, 1986.
    """
    return _smallest(interval, rate, lambda factor: decided(interval, factor, rate) >= power)


def decided(interval: Interval, factor: float, rate: float = 1.0) -> float:
    """Probability that an interval of `factor` times the present images excludes 0."""
    error, freedom = _error(interval)
    error /= math.sqrt(rate)
    half = half_width(interval, factor, rate)
    if error == 0 or factor <= 1:
        return float(abs(interval.value) > half)
    spread = error * math.sqrt((factor - 1) / factor)
    above = special.stdtr(freedom, (interval.value - half) / spread)
    below = special.stdtr(freedom, (-interval.value - half) / spread)
    return float(above + below)


def half_width(interval: Interval, factor: float, rate: float = 1.0) -> float:
    """Expected half of the width of the interval of `factor` times the present images.

    Simulated images divide the variance by their exchange `rate`; they are no further visits.
    """
    error, _ = _error(interval)
    critical = float(special.stdtrit(_freedom(interval, factor), 0.5 + interval.level / 2))
    return critical * error / math.sqrt(factor * rate)


def _smallest(interval: Interval, rate: float, holds: Callable[[float], bool]) -> MoreImages:
    """The fewest further images after which `holds(factor of the present images)`."""
    if not interval.is_known or interval.sample is None:
        return MoreImages(0, 0, interval.no_bounds)
    if math.isinf(interval.low) or math.isinf(interval.high):
        return MoreImages(0, 0, "the interval is open: more images are needed before a plan")
    if not math.isfinite(rate):
        return MoreImages(0, 0, "the exchange rate is not known")
    sample = interval.sample
    if holds(1.0):
        return MoreImages(0, 0)
    if not holds(MOST):
        return MoreImages(0, 0, f"more than {MOST:g} times the present real images")
    few, many = 1.0, MOST
    for _ in range(_STEPS):
        middle = (few + many) / 2
        few, many = (few, middle) if holds(middle) else (middle, many)
    population = sample.trajectories >= FEWEST_TRAJECTORIES
    visits = math.ceil(sample.trajectories * (many - 1)) if population else 0
    return MoreImages(math.ceil(sample.n * (many - 1)), visits)


def _error(interval: Interval) -> tuple[float, float]:
    """Standard error and degrees of freedom of an estimate, from its interval."""
    freedom = _freedom(interval, 1.0)
    half = (interval.high - interval.low) / 2
    return half / float(special.stdtrit(freedom, 0.5 + interval.level / 2)), freedom


def _freedom(interval: Interval, factor: float) -> float:
    """Degrees of freedom of `factor` times the present images, in as many times the visits."""
    sample = interval.sample
    if sample is None:
        return math.inf
    if sample.trajectories >= FEWEST_TRAJECTORIES:
        return sample.trajectories * factor - 1
    return series_freedom(sample.n * factor)
