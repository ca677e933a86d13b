"""Time delay between two logs of one command sequence, with sub-sample precision.

Forward speed, sideways speed and yaw rate of both logs are smoothed equally and compared: first at
every whole lag by their correlation over the overlap, then by least squares over a continuous shift
with free gain and offset per rate. The score -sum log(1 - r^2) over the rates is the likelihood for
unknown noise of each rate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage, optimize
from scipy.interpolate import CubicSpline

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.intervals import LEVEL, Interval, of_units
from s2rtools.motion_logs.motion_log import Floats, Log, poses_at

RATES = ("forward speed", "sideways speed", "yaw rate")
RATE = 50.0
"""Grid on which logs are compared, Hz."""
SMOOTHING = 0.1
"""Standard deviation of the Gaussian, s; at least `MIN_SMOOTHING_SAMPLES` of the slower log."""
MIN_SMOOTHING_SAMPLES = 1.5
MAX_STEP = 10.0
"""Longest median time between two poses, s."""
MIN_OVERLAP = 2.0
"""Shortest duration of a log and of the overlap, s."""
BLOCK = 2.0
"""Length of the blocks that count as independent, s."""
MAX_BLOCKS = 200
MIN_GRID_TIMES = 8
"""Fewest grid times at which blocks are compared."""
STILL = 1e-4
"""Speed below which nothing moves, m/s and rad/s."""
MIN_Z_SCORE = 4.0
"""Smallest z score (Fisher transform) of the best correlation."""
_BLOCK_SHIFTS = 41
_TRUNCATE = 3.0
"""Half width of the smoothing kernel, in its standard deviations."""


@dataclass(frozen=True, slots=True)
class TimeDelay:
    """Time delay of the real log behind the simulated one, s; negative where reality is earlier.

    `left_out` (B,) are the delays without each of B blocks of the overlap. `correlation` holds that
    of each of `RATES` at the delay; `overlap` is in s.
    """

    seconds: float
    left_out: Floats
    correlation: dict[str, float]
    overlap: float

    def interval(self, level: float = LEVEL) -> Interval:
        """The delay with its interval, s."""
        return of_units(self.seconds, self.left_out, unit=f"blocks of {BLOCK:g} s", level=level)

    @property
    def error(self) -> float:
        """Standard error of the delay, s."""
        n = self.left_out.size
        return float(np.sqrt((n - 1) * self.left_out.var()))


@dataclass(frozen=True, slots=True)
class _Rates:
    """Rates (n, 3) at the grid times (first + k) * step after a common origin."""

    first: int
    values: Floats


def shifted(log: Log, delay: float) -> Log:
    """The log with all times later by `delay` seconds."""
    return replace(log, time=log.time + delay)


class DelayEstimates:
    """Estimates of time delays between pairs of logs, each computed once."""

    def __init__(self) -> None:
        self._known: dict[tuple[int, int, float, float], tuple[Log, Log, TimeDelay]] = {}

    def __call__(self, real: Log, sim: Log, rate: float, max_delay: float) -> TimeDelay:
        """The delay as `estimate_delay` finds it, with its errors."""
        key = (id(real), id(sim), rate, max_delay)
        if key not in self._known:  # with the logs, so that no other log gets their ids
            self._known[key] = (real, sim, estimate_delay(real, sim, rate, max_delay))
        return self._known[key][2]


def estimate_delay(real: Log, sim: Log, rate: float = RATE, max_delay: float = 1.0) -> TimeDelay:
    """Estimate how much later `real` is than `sim`, within `max_delay` s on a grid of `rate` Hz.

    Raises RequestError where the logs do not overlap, and InconclusiveError where nothing moves,
    no delay is significant, the best delay is at the end of the search, or the overlap is too short
    for an interval.
    """
    step, most, names = 1.0 / rate, round(max_delay * rate), f"{real.source} and {sim.source}"
    width = max(SMOOTHING, MIN_SMOOTHING_SAMPLES * max(_step(real), _step(sim)))
    overlap = _checked_overlap(real, sim, width)
    origin = max(real.time[0], sim.time[0])
    a, b = (_rates(log, origin, step, width) for log in (real, sim))
    whole = _best_whole_lag(a, b, most, names, step)
    rates_at = _rates_at_shift(a, b, whole)
    shift = optimize.minimize_scalar(
        lambda each: -_score(_correlation(*rates_at(each))), bounds=(whole - 1, whole + 1),
        method="bounded", options={"xatol": 1e-5},
    ).x  # fmt: skip
    correlation = _correlation(*rates_at(shift))
    _require_significant(correlation, overlap, width, names)
    try:
        left_out = _shifts_without_blocks(rates_at, shift, step, most) * step
    except InconclusiveError as error:
        raise InconclusiveError(f"{names}: {error}") from error
    return TimeDelay(
        float(shift) * step, left_out, dict(zip(RATES, correlation.tolist(), strict=True)), overlap
    )


def _checked_overlap(real: Log, sim: Log, width: float) -> float:
    """Duration of the overlap, s.

    Raises RequestError for logs that are too short, do not overlap, or are sampled too slowly for a
    smoothing of `width` s.
    """
    for log in (real, sim):
        if _seconds(log) < MIN_OVERLAP:
            raise RequestError(
                f"{log.source}: {log.time.size} poses in {_seconds(log):.3g} s; a delay needs "
                f"{MIN_OVERLAP:g} s of both logs"
            )
    overlap = float(min(real.time[-1], sim.time[-1]) - max(real.time[0], sim.time[0]))
    if overlap < MIN_OVERLAP:
        spans = " and ".join(
            f"{log.source} ({log.time[0]:.6g} to {log.time[-1]:.6g} s)" for log in (real, sim)
        )
        raise RequestError(f"{spans} overlap by less than {MIN_OVERLAP:g} s; use one clock")
    shorter, slower = min(real, sim, key=_seconds), max(real, sim, key=_step)
    if _seconds(shorter) <= 2 * _TRUNCATE * width or _step(slower) > MAX_STEP:
        raise RequestError(
            f"{slower.source}: a pose every {_step(slower):.3g} s is too slow to estimate a time "
            f"delay over the {_seconds(shorter):.3g} s of {shorter.source}; are both "
            "clocks in seconds?"
        )
    return overlap


def _seconds(log: Log) -> float:
    return float(log.time[-1] - log.time[0])


def _step(log: Log) -> float:
    """Median time between two poses, s."""
    return float(np.median(np.diff(log.time)))


def _rates(log: Log, origin: float, step: float, width: float) -> _Rates:
    """Smoothed body rates, without the ends that the smoothing kernel does not cover."""
    first = int(np.ceil((log.time[0] - origin) / step - 1e-9))
    last = int(np.floor((log.time[-1] - origin) / step + 1e-9))
    times = np.clip(origin + np.arange(first, last + 1) * step, log.time[0], log.time[-1])
    x, y, heading = poses_at(log, times)
    sigma = width / step

    def slope(values: Floats) -> Floats:
        per_step: Floats = ndimage.gaussian_filter1d(values, sigma, order=1, truncate=_TRUNCATE)
        return per_step / step

    facing = ndimage.gaussian_filter1d(heading, sigma, truncate=_TRUNCATE)
    vx, vy = slope(x), slope(y)
    cos, sin = np.cos(facing), np.sin(facing)
    values = np.stack([vx * cos + vy * sin, vy * cos - vx * sin, slope(heading)], axis=1)
    edge = int(np.ceil(_TRUNCATE * sigma))
    if values.shape[0] <= 2 * edge + 4:
        raise RequestError(
            f"{log.source}: {_seconds(log):.3g} s of poses every {_step(log):.3g} s are too few "
            "to estimate a time delay"
        )
    values = values[edge:-edge]
    if values.std(axis=0).max() < STILL:
        raise InconclusiveError(
            f"{log.source}: the motion never changes; no time delay can be estimated"
        )
    return _Rates(first + edge, values)


def _correlation(a: Floats, b: Floats) -> Floats:
    """Pearson correlation of each column; 0 where a column is constant."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    scale = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    floor = len(a) * STILL**2
    return np.where(scale > floor, (a * b).sum(axis=0) / np.maximum(scale, floor), 0.0)


def _score(correlation: Floats) -> float:
    explained = np.minimum(np.maximum(correlation, 0.0) ** 2, 1 - 1e-15)
    return float(-np.log1p(-explained).sum())


def _best_whole_lag(a: _Rates, b: _Rates, max_delay: int, names: str, step: float) -> int:
    """The lag in samples at which the logs correlate best."""
    lags = range(-max_delay - 1, max_delay + 2)
    spans = [_span(a, b, lag, lag) for lag in lags]
    shortest = max(max(high - low for low, high in spans) // 2, 4)
    scores = []
    for lag, (low, high) in zip(lags, spans, strict=True):
        if high - low < shortest:
            scores.append(-np.inf)
            continue
        here = a.values[low - a.first : high - a.first]
        there = b.values[low - lag - b.first : high - lag - b.first]
        scores.append(_score(_correlation(here, there)))
    best = lags[int(np.argmax(scores))]
    if abs(best) > max_delay:
        raise InconclusiveError(
            f"{names}: correlate best at {best * step:+.3g} s, the end of the search range; "
            "search further (--dynamics reach=...), or check the clocks"
        )
    return best


def _span(a: _Rates, b: _Rates, least: float, most: float) -> tuple[int, int]:
    """Grid times [low, high) of `a` at which `b` is known for every lag from `least` to `most`."""
    low = max(a.first, int(np.ceil(b.first + most)))
    high = min(a.first + len(a.values), int(np.floor(b.first + len(b.values) - 1 + least)) + 1)
    return low, max(low, high)


RatesAtShift = Callable[..., tuple[Floats, Floats]]


def _rates_at_shift(a: _Rates, b: _Rates, whole: int) -> RatesAtShift:
    """Function of a shift in samples that returns the rates (n, 3) of both logs.

    The rates cover all grid times at which both are known for shifts of up to `reach` samples from
    `around`.
    """
    spline = CubicSpline(np.arange(len(b.values)), b.values)

    def at(shift: float, reach: float = 1.0, around: float = whole) -> tuple[Floats, Floats]:
        low, high = _span(a, b, around - reach, around + reach)
        times = np.arange(low, high)
        return a.values[low - a.first : high - a.first], spline(times - shift - b.first)

    return at


def _require_significant(correlation: Floats, overlap: float, width: float, names: str) -> None:
    """Raises InconclusiveError unless a correlation is significant.

    Under noise, Fisher's z of n independent values has a standard deviation of 1 / sqrt(n - 3).
    """
    n = max(overlap / (2 * np.sqrt(np.pi) * width), 4.0)
    needed = float(np.tanh(MIN_Z_SCORE / np.sqrt(n - 3)))
    if correlation.max() < needed:
        raise InconclusiveError(
            f"{names}: the motions do not correlate at any time delay "
            f"(correlation {correlation.max():.2f}, {needed:.2f} needed over {overlap:.3g} s)"
        )


def _shifts_without_blocks(
    rates_at: RatesAtShift, best: float, step: float, max_delay: int
) -> Floats:
    """Shifts without each block, in samples; the search widens until none is at its border."""
    reach = 2.0
    while True:
        delays, inside = _left_out_shifts(rates_at, best, step, reach)
        if inside or reach >= max_delay:
            return delays
        reach = min(4 * reach, float(max_delay))


def _left_out_shifts(
    rates_at: RatesAtShift, best: float, step: float, reach: float
) -> tuple[Floats, bool]:
    shifts = np.linspace(-reach, reach, _BLOCK_SHIFTS)
    pairs = [rates_at(best + shift, reach, best) for shift in shifts]
    n = min(len(a) for a, _ in pairs)
    if n < MIN_GRID_TIMES:
        raise InconclusiveError(
            f"the logs overlap by {max(n, 0) * step:.3g} s within the search range, too short for "
            "an interval of the time delay; record longer drives"
        )
    length = max(round(BLOCK / step), -(-n // MAX_BLOCKS))
    blocks = max(n // length, 2)
    edges = np.linspace(0, n, blocks + 1).astype(int)[:-1]
    products = (np.stack([np.ones_like(a), a, b, a * a, b * b, a * b]) for a, b in pairs)
    per_block = [np.add.reduceat(each, edges, axis=1) for each in products]
    sums = np.stack(per_block, axis=2)  # 1, a, b, aa, bb, ab; blocks; shifts; rates
    total = sums.sum(axis=1)
    middle = _unexplained_squares(total)[_BLOCK_SHIFTS // 2]
    residual = _unexplained_squares(total[:, None] - sums) @ (1.0 / np.maximum(middle, 1e-12 * n))
    at = np.argmin(residual, axis=1)
    inside = bool(((at > 0) & (at < _BLOCK_SHIFTS - 1)).all())
    at = np.clip(at, 1, _BLOCK_SHIFTS - 2)
    rows = np.arange(len(at))
    before, here, after = (residual[rows, at + i] for i in (-1, 0, 1))
    bend = np.maximum(before - 2 * here + after, 1e-300)
    fine = np.clip(0.5 * (before - after) / bend, -1, 1)
    deviation = shifts[at] + fine * (shifts[1] - shifts[0])
    return best + deviation, inside


def _unexplained_squares(sums: Floats) -> Floats:
    """Residual squares of the regression of a on b, from sums 1, a, b, aa, bb, ab (6, ...)."""
    n, a, b, aa, bb, ab = sums
    aa, bb, ab = aa - a * a / n, bb - b * b / n, ab - a * b / n
    return np.asarray(np.maximum(aa - ab**2 / np.maximum(bb, n * STILL**2), 0.0))
