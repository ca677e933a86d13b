"""Simulated pose errors with known truth, for the benches of intervals and verdicts.

A series is monotone in a latent normal process: an autoregression of order 1 with correlation rho
between neighbours, plus a level of its own for each trajectory that is the share `icc` of the
variance.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats

Floats = NDArray[np.float64]

SIGMA = 0.9
"""Standard deviation of log errors."""
BURST_SHARE, BURST_ERROR = 0.08, 12.0
"""Share of failures, and their error in the median error of the others."""


@dataclass(frozen=True, slots=True)
class Process:
    """Distribution of errors: `normal`, `lognormal`, or `bursts` of failures; dependence; units."""

    errors: str
    n: int
    rho: float
    trajectories: int = 1
    icc: float = 0.0

    def __str__(self) -> str:
        return f"{self.errors} n {self.n} rho {self.rho} T {self.trajectories} ICC {self.icc}"

    @property
    def codes(self) -> NDArray[np.int64]:
        """Trajectory of each row, (n,)."""
        return np.arange(self.n) * self.trajectories // self.n

    def latent(self, rng: np.random.Generator, repeats: int) -> Floats:
        """Standard normal values (repeats, n)."""
        noise = rng.standard_normal((repeats, self.n))
        starts = np.flatnonzero(np.diff(self.codes, prepend=-1))
        parts = []
        for first, end in zip(starts, [*starts[1:], self.n], strict=True):
            part = noise[:, first:end] * np.sqrt(1 - self.rho**2)
            part[:, 0] = noise[:, first]
            parts.append(signal.lfilter([1.0], [1.0, -self.rho], part, axis=1))
        levels = rng.standard_normal((repeats, self.trajectories))[:, self.codes]
        within = np.concatenate(parts, axis=1)
        return np.asarray(np.sqrt(1 - self.icc) * within + np.sqrt(self.icc) * levels)

    def values(self, latent: Floats) -> Floats:
        """Errors of latent values, elementwise and monotone."""
        if self.errors == "normal":
            return latent
        if self.errors == "lognormal":
            return np.exp(SIGMA * latent)
        limit = stats.norm.isf(BURST_SHARE)
        return np.where(latent > limit, BURST_ERROR, 1.0) * np.exp(SIGMA / 3 * latent)

    def draw(self, rng: np.random.Generator, repeats: int) -> Floats:
        """Errors (repeats, n)."""
        return self.values(self.latent(rng, repeats))

    def quantile(self, q: float) -> float:
        """True quantile of the errors."""
        return float(self.values(np.array([stats.norm.ppf(q)]))[0])

    def share_below(self, limit: float) -> float:
        """True share of errors below a limit."""
        return float((_grid_values(self.errors) < limit).mean())

    def mean(self) -> float:
        """True mean error."""
        return float(_grid_values(self.errors).mean())

    def positive(self, values: Floats) -> Floats:
        """Errors above 0: those of the normal distribution, which has others, are exponentiated."""
        return np.exp(values) if self.errors == "normal" else values


@lru_cache
def _grid_values(errors: str) -> Floats:
    points = (np.arange(2_000_000) + 0.5) / 2_000_000
    return Process(errors, 1, 0.0).values(stats.norm.ppf(points))
