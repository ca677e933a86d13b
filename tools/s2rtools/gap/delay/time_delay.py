"""The delay between two logs of one command sequence, to a fraction of a sample.

Forward speed, sideways speed and yaw rate of both logs, smoothed alike, are compared: per whole
lag by the correlation over what overlaps at that lag, then by least squares on the continuous
shift with gain and offset of every rate left free. Rates weigh by how much of them the other log
explains, the likelihood of unknown noise per rate: -sum log(1 - r^2).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, optimize
from scipy.interpolate import CubicSpline

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.metrics.bootstrap import percentile_bounds
from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.bootstrap_correction import small_sample
from s2rtools.motion_logs.motion_log import Floats, Log
from s2rtools.motion_logs.resample import poses_at

RATES = ("forward speed", "sideways speed", "yaw rate")
SMOOTHING = 0.1
"""Deviation of the Gaussian, s; at least `SAMPLES` of the slower log."""
SAMPLES = 1.5
SLOWEST = 10.0
"""s between two poses."""
MIN_OVERLAP = 2.0
"""s"""
BLOCK = 2.0
"""s, of the bootstrap."""
MAX_BLOCKS = 200
LEAST = 8
"""Grid times that every shift of the bootstrap must be judged on."""
STILL = 1e-4
"""m/s and rad/s below which nothing moves."""
CLEAR = 4.0
"""Deviations by which Fisher's z of the best correlation must stand above none."""
_BLOCK_SHIFTS = 41
_REACH = 3.0
_DEFAULTS = GapSettings()


@dataclass(frozen=True, slots=True)
class TimeDelay:
    """`seconds` that the real log comes after the simulated one; negative = before.

    `low`, `high` bound it at the settings' level, from `replicates` (R,). `correlation` is that of
    each of `RATES` at the delay, `overlap` in s.
    """

    seconds: float
    low: float
    high: float
    replicates: Floats
    correlation: dict[str, float]
    overlap: float


@dataclass(frozen=True, slots=True)
class _Rates:
    """Rates (n, 3) at the times (first + k) * step after `origin`."""

    first: int
    values: Floats


def without(log: Log, delay: float) -> Log:
    """The simulated log, later by `delay` s: what it would be if it were as late as the real."""
    return replace(log, time=log.time + delay)


def delay(
    real: Log,
    sim: Log,
    settings: GapSettings = _DEFAULTS,
    rate: float = 50.0,
    furthest: float = 1.0,
) -> TimeDelay:
    """How much later `real` is than `sim`, searched within `furthest` s on a grid of `rate` Hz.

    Raises RequestError where the logs do not overlap, InconclusiveError where nothing moves, where
    no delay stands out, where the best is the furthest, or where too little is left to bound it.
    """
    overlap = _overlap(real, sim)
    step = 1.0 / rate
    origin = max(real.time[0], sim.time[0])
    width = max(SMOOTHING, SAMPLES * max(_step(real), _step(sim)))
    _demand_fine(real, sim, width)
    a, b = (_rates(log, origin, step, width) for log in (real, sim))
    whole = _whole_lag(a, b, round(furthest * rate), f"{real.source} and {sim.source}", step)
    score, matched = _matched(a, b, whole)
    found = optimize.minimize_scalar(
        lambda shift: -score(shift), bounds=(whole - 1, whole + 1), method="bounded",
        options={"xatol": 1e-5},
    ).x  # fmt: skip
    correlation = _correlation(*matched(found))
    _demand_clear(correlation, overlap, width, f"{real.source} and {sim.source}")
    try:
        spread = _bootstrap(matched, found, step, round(furthest * rate), settings) * step
    except InconclusiveError as error:
        raise InconclusiveError(f"{real.source} and {sim.source}: {error}") from error
    low, high = percentile_bounds(spread, settings.level)
    return TimeDelay(
        float(found) * step, low, high, spread,
        dict(zip(RATES, correlation.tolist(), strict=True)), overlap,
    )  # fmt: skip


def _overlap(real: Log, sim: Log) -> float:
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
    return overlap


def _demand_fine(real: Log, sim: Log, width: float) -> None:
    """Raises RequestError for logs that are too slow, or end before their rates are known, which
    are smoothed by `width` s.
    """
    shorter = min(real, sim, key=_seconds)
    slower = max(real, sim, key=_step)
    if _seconds(shorter) <= 2 * _REACH * width or _step(slower) > SLOWEST:
        raise RequestError(
            f"{slower.source}: a pose every {_step(slower):.3g} s is too few to find a delay by in "
            f"the {_seconds(shorter):.3g} s of {shorter.source}; are both clocks in seconds?"
        )


def _seconds(log: Log) -> float:
    return float(log.time[-1] - log.time[0])


def _step(log: Log) -> float:
    """The median, s."""
    return float(np.median(np.diff(log.time)))


def _rates(log: Log, origin: float, step: float, width: float) -> _Rates:
    """Smoothed body rates, without the ends that the smoothing does not know."""
    first = int(np.ceil((log.time[0] - origin) / step - 1e-9))
    last = int(np.floor((log.time[-1] - origin) / step + 1e-9))
    times = np.clip(origin + np.arange(first, last + 1) * step, log.time[0], log.time[-1])
    x, y, heading = poses_at(log, times)
    sigma = width / step

    def slope(values: Floats) -> Floats:
        found: Floats = ndimage.gaussian_filter1d(values, sigma, order=1, truncate=_REACH)
        return found / step

    facing = ndimage.gaussian_filter1d(heading, sigma, truncate=_REACH)
    vx, vy = slope(x), slope(y)
    cos, sin = np.cos(facing), np.sin(facing)
    values = np.stack([vx * cos + vy * sin, vy * cos - vx * sin, slope(heading)], axis=1)
    edge = int(np.ceil(_REACH * sigma))
    if values.shape[0] <= 2 * edge + 4:
        raise RequestError(
            f"{log.source}: {_seconds(log):.3g} s of poses every {_step(log):.3g} s are too few "
            "to find a delay by"
        )
    values = values[edge:-edge]
    if values.std(axis=0).max() < STILL:
        raise InconclusiveError(f"{log.source}: the motion never changes; no delay can be seen")
    return _Rates(first + edge, values)


def _correlation(a: Floats, b: Floats) -> Floats:
    """Pearson's per column; 0 where a column does not change."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    scale = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    floor = len(a) * STILL**2
    return np.where(scale > floor, (a * b).sum(axis=0) / np.maximum(scale, floor), 0.0)


def _score(correlation: Floats) -> float:
    explained = np.minimum(np.maximum(correlation, 0.0) ** 2, 1 - 1e-15)
    return float(-np.log1p(-explained).sum())


def _whole_lag(a: _Rates, b: _Rates, furthest: int, where: str, step: float) -> int:
    """The lag in samples at which the logs agree best."""
    lags = range(-furthest - 1, furthest + 2)
    spans = [_span(a, b, lag, lag) for lag in lags]
    least = max(max(high - low for low, high in spans) // 2, 4)
    scores = []
    for lag, (low, high) in zip(lags, spans, strict=True):
        if high - low < least:
            scores.append(-np.inf)
            continue
        here = a.values[low - a.first : high - a.first]
        there = b.values[low - lag - b.first : high - lag - b.first]
        scores.append(_score(_correlation(here, there)))
    best = lags[int(np.argmax(scores))]
    if abs(best) > furthest:
        raise InconclusiveError(
            f"{where}: agree best at {best * step:+.3g} s, the end of the search; "
            "search further, or check the clocks"
        )
    return best


def _span(a: _Rates, b: _Rates, least: float, most: float) -> tuple[int, int]:
    """Grid times [low, high) of `a` at which `b` is known for every lag from least to most."""
    low = max(a.first, int(np.ceil(b.first + most)))
    high = min(a.first + len(a.values), int(np.floor(b.first + len(b.values) - 1 + least)) + 1)
    return low, max(low, high)


Matched = Callable[..., tuple[Floats, Floats]]


def _matched(a: _Rates, b: _Rates, whole: int) -> tuple[Callable[[float], float], Matched]:
    """The score of a shift in samples, and the rates (n, 3) of both logs at a shift."""
    spline = CubicSpline(np.arange(len(b.values)), b.values)

    def at(shift: float, reach: float = 1.0, around: float = whole) -> tuple[Floats, Floats]:
        low, high = _span(a, b, around - reach, around + reach)
        times = np.arange(low, high)
        return a.values[low - a.first : high - a.first], spline(times - shift - b.first)

    return lambda shift: _score(_correlation(*at(shift))), at


def _demand_clear(correlation: Floats, overlap: float, width: float, where: str) -> None:
    """Smoothed noise of n independent values reaches Fisher's z of a few / sqrt(n - 3)."""
    n = max(overlap / (2 * np.sqrt(np.pi) * width), 4.0)
    needed = float(np.tanh(CLEAR / np.sqrt(n - 3)))
    if correlation.max() < needed:
        raise InconclusiveError(
            f"{where}: the motions do not agree at any delay "
            f"(correlation {correlation.max():.2f}, {needed:.2f} needed over {overlap:.3g} s)"
        )


def _bootstrap(
    matched: Matched, best: float, step: float, furthest: int, settings: GapSettings
) -> Floats:
    """Delays in samples of resampled blocks; the search widens until none ends at its border."""
    reach = 2.0
    while True:
        found, inside = _resampled(matched, best, step, reach, settings)
        if inside or reach >= furthest:
            return found
        reach = min(4 * reach, float(furthest))


def _resampled(
    matched: Matched, best: float, step: float, reach: float, settings: GapSettings
) -> tuple[Floats, bool]:
    shifts = np.linspace(-reach, reach, _BLOCK_SHIFTS)
    pairs = [matched(best + shift, reach, best) for shift in shifts]
    n = min(len(a) for a, _ in pairs)
    if n < LEAST:
        raise InconclusiveError(
            f"{max(n, 0) * step:.3g} s are left where the logs overlap, too short to bound their "
            "delay; drive longer"
        )
    length = max(round(BLOCK / step), -(-n // MAX_BLOCKS))
    blocks = max(n // length, 2)
    edges = np.linspace(0, n, blocks + 1).astype(int)[:-1]
    sums = np.stack([_block_sums(a, b, edges) for a, b in pairs], axis=2)  # 6, blocks, shifts, 3
    rng = np.random.default_rng(settings.seed)
    counts = rng.multinomial(blocks, np.full(blocks, 1 / blocks), settings.replicates)
    middle = _left_over(sums.sum(axis=1))[_BLOCK_SHIFTS // 2]
    weights = 1.0 / np.maximum(middle, 1e-12 * n)
    left = _left_over(np.einsum("rb,kbsc->krsc", counts, sums, optimize=True)) @ weights
    at = np.argmin(left, axis=1)
    inside = bool(((at > 0) & (at < _BLOCK_SHIFTS - 1)).all())
    at = np.clip(at, 1, _BLOCK_SHIFTS - 2)
    rows = np.arange(len(at))
    before, here, after = (left[rows, at + i] for i in (-1, 0, 1))
    bend = np.maximum(before - 2 * here + after, 1e-300)
    fine = np.clip(0.5 * (before - after) / bend, -1, 1)
    deviation = shifts[at] + fine * (shifts[1] - shifts[0])
    return best + deviation * small_sample(blocks, settings.level), inside


def _block_sums(a: Floats, b: Floats, edges: NDArray[np.int_]) -> Floats:
    """Sums of 1, a, b, aa, bb, ab per block, shape (6, blocks, 3)."""
    parts = np.stack([np.ones_like(a), a, b, a * a, b * b, a * b])
    return np.asarray(np.add.reduceat(parts, edges, axis=1))


def _left_over(sums: Floats) -> Floats:
    """Squares of a that b does not explain, gain and offset free; over the first axis of sums."""
    n, a, b, aa, bb, ab = sums
    aa, bb, ab = aa - a * a / n, bb - b * b / n, ab - a * b / n
    return np.asarray(np.maximum(aa - ab**2 / np.maximum(bb, n * STILL**2), 0.0))
