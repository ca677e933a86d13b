"""Windowed prediction error of a simulator, as least squares over its parameters.

Each window restarts from the measured real state, whose five numbers are estimated along with the
parameters; a weak prior about them keeps windows at rest determined. `refined` fits all of them
together. Elsewhere the start states are eliminated linearly (variable projection; Golub and Pereyra
1973), which takes two more replays and leaves residuals that depend on the parameters alone.

On held-out windows the error is compared before and after identification. Windows of one drive
depend on each other, so drives are the independent units.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import optimize, sparse

from s2rstore.intervals import Interval, of_units
from s2rtools.sysid.parameter_space import Space
from s2rtools.sysid.simulators.simulator import Floats, Integers
from s2rtools.sysid.windows import SysidWindows

_DOUBT = np.array([0.02, 0.02, 0.02, 0.15, 0.3])
"""Standard deviation of measured start states, generous: m, m, rad, m/s, rad/s."""
_FD_STEP = np.array([1e-4, 1e-4])
_STEP = 1e-3
"""Step of the numerical derivatives, in the unit cube."""
_WORST = 1e12
_MAX_EVALUATIONS = 100
"""Evaluations of one fit, each with its derivatives."""
_EXACT_STEP = {"regularize": False, "atol": 1e-12, "btol": 1e-12, "maxiter": 3000}
"""Options of LSMR; with its defaults, steps are so inexact that a fit needs hundreds of them."""
_MAX_HEADING_RATIO = 1.02
"""Largest ratio of heading errors after and before that counts as no worse."""
_TINY = 1e-12
"""Sum of errors in metres below which all count as equal."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictionError:
    """Residuals over `space`, in units of `sigma` (3,): m, m, rad.

    They are linearised at the start states `starts` (w, 5).
    """

    space: Space
    windows: SysidWindows
    sigma: Floats
    starts: Floats

    @classmethod
    def of_windows(cls, space: Space, windows: SysidWindows) -> PredictionError:
        """The problem in units of the windows' noise, from their measured starts."""
        return cls(space, windows, windows.noise, windows.starts)

    def __len__(self) -> int:
        return 3 * len(self.windows.replays.times)

    def of(self, windows: SysidWindows) -> PredictionError:
        """The same problem on other windows, from their measured starts."""
        return replace(self, windows=windows, starts=windows.starts)

    def residuals(self, cube: Floats) -> Floats:
        """Residuals (n, 3) in units of `sigma`, with the best start states."""
        return self._eliminated(cube)[0]

    def cost(self, cube: Floats) -> float:
        """Mean square residual with the best start states; always finite."""
        mean = self._eliminated(cube)[2] / len(self)
        return mean if np.isfinite(mean) else _WORST

    def restarted(self, cube: Floats) -> PredictionError:
        """The same problem, linearised at the start states that fit best."""
        return replace(self, starts=self.starts + self._eliminated(cube)[1])

    def jacobian(self, cube: Floats) -> Floats:
        """The Jacobian of `residuals` by the p parameters, (n, 3, p)."""
        return self._differences(self.residuals, cube)

    def predicted(self, cube: Floats) -> Floats:
        """States (n, 5) simulated from the measured starts."""
        values = self.space.values(cube)
        return self.space.simulator.replay(values, self.windows.replays, self.windows.starts)

    def refined(self, cube: Floats) -> tuple[PredictionError, Floats]:
        """The optimum of parameters and start states together near `cube` (p,).

        Returns the problem with the best start states, and the parameters.
        """
        count = len(cube)

        def at(point: Floats) -> tuple[PredictionError, Floats]:
            starts = point[count:].reshape(self.starts.shape)
            return replace(self, starts=starts), point[:count]

        def residuals(point: Floats) -> Floats:
            problem, cube = at(point)
            away = (problem.starts - self.windows.starts) / _DOUBT
            return np.append(problem._deviations(cube), away)

        def jacobian(point: Floats) -> sparse.csr_matrix:
            problem, cube = at(point)
            return problem._joint_jacobian(cube)

        free = np.full(self.starts.size, np.inf)
        bounds = np.append(np.zeros(count), -free), np.append(np.ones(count), free)
        start = np.append(np.clip(cube, 1e-9, 1 - 1e-9), self.starts)
        found = optimize.least_squares(
            residuals, start, jacobian, bounds, x_scale="jac", xtol=1e-7, ftol=1e-7, gtol=1e-10,
            tr_solver="lsmr", tr_options=_EXACT_STEP, max_nfev=_MAX_EVALUATIONS,
        )  # fmt: skip
        return at(found.x)

    def _joint_jacobian(self, cube: Floats) -> sparse.csr_matrix:
        """Derivatives of deviations (n, 3) and prior (w, 5) by the parameters and start states."""
        by_parameters = self._differences(self._deviations, cube)
        by_starts = self._linearised(cube)[1]
        window, states = np.repeat(self.windows.window_of_row, 3), self.starts.size
        row = np.arange(len(window))
        deviations = sparse.csr_matrix(
            (by_starts.ravel(), (np.repeat(row, 5), (5 * window[:, None] + np.arange(5)).ravel())),
            shape=(len(window), states),
        )
        prior = sparse.diags(np.tile(1 / _DOUBT, len(self.starts)))
        return sparse.bmat(
            [[by_parameters.reshape(len(window), -1), deviations], [None, prior]], format="csr"
        )

    def _deviations(self, cube: Floats) -> Floats:
        """Deviations (n, 3) from `starts`, in units of `sigma`; always finite."""
        values, replays = self.space.values(cube), self.windows.replays
        states = self.space.simulator.replay(values, replays, self.starts)
        off = (states[:, :3] - self.windows.poses) / self.sigma
        return np.nan_to_num(off, nan=_WORST**0.5, posinf=_WORST**0.5, neginf=-(_WORST**0.5))

    def _differences(self, of: Callable[[Floats], Floats], cube: Floats) -> Floats:
        """Derivatives of a function by the coordinates (..., p); one-sided at a range limit."""
        columns = []
        for i in range(len(cube)):
            low, high = cube.copy(), cube.copy()
            low[i], high[i] = max(cube[i] - _STEP, 0.0), min(cube[i] + _STEP, 1.0)
            columns.append((of(high) - of(low)) / (high[i] - low[i]))
        return np.stack(columns, axis=-1)

    def _linearised(self, cube: Floats) -> tuple[Floats, Floats]:
        """Residuals (n, 3) and their Jacobian (n, 3, 5) by the start state of the window."""
        values, replays = self.space.values(cube), self.windows.replays
        starts, replay = self.starts, self.space.simulator.replay
        states = replay(values, replays, starts)
        deviations = (states[:, :3] - self.windows.poses) / self.sigma
        sensitivity = np.zeros((*deviations.shape, 5))
        begin = starts[self.windows.window_of_row]
        sensitivity[:, 0, 0] = sensitivity[:, 1, 1] = sensitivity[:, 2, 2] = 1.0
        sensitivity[:, 0, 2] = -(states[:, 1] - begin[:, 1])
        sensitivity[:, 1, 2] = states[:, 0] - begin[:, 0]
        for i, nudge in enumerate(_FD_STEP):
            nudged = starts.copy()
            nudged[:, 3 + i] += nudge
            other = replay(values, replays, nudged)
            sensitivity[:, :, 3 + i] = (other[:, :3] - states[:, :3]) / nudge
        return deviations, sensitivity / self.sigma[:, None]

    def _eliminated(self, cube: Floats) -> tuple[Floats, Floats, float]:
        """Residuals, corrections of the starts (w, 5) and the sum of squares."""
        residual, sensitivity = self._linearised(cube)
        if not np.isfinite(residual).all() or not np.isfinite(sensitivity).all():
            return np.full_like(residual, np.sqrt(_WORST)), np.zeros_like(self.starts), np.inf
        first, moved = self.windows.replays.first[:-1], self.starts - self.windows.starts
        sums = np.einsum("ncp,ncq->npq", sensitivity, sensitivity)
        normal = np.add.reduceat(sums, first) + np.diag(_DOUBT**-2.0)
        products = np.einsum("ncp,nc->np", sensitivity, residual)
        right = np.add.reduceat(products, first) + moved * _DOUBT**-2.0
        corrections = -np.linalg.solve(normal, right[:, :, None])[:, :, 0]
        residual += np.einsum("ncp,np->nc", sensitivity, corrections[self.windows.window_of_row])
        away = ((moved + corrections) / _DOUBT) ** 2
        return residual, corrections, float((residual**2).sum() + away.sum())


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Root mean square position (m) and heading (rad) errors of the windows.

    ratio: mean position error after the change over that before, as the geometric mean of the
    drives.
    """

    drives: int
    windows: int
    untuned: tuple[float, float]
    fitted: tuple[float, float]
    ratio: Interval

    @property
    def helps(self) -> bool:
        """Whether position errors fall significantly and heading errors do not rise."""
        return self.ratio.high < 1 and self.fitted[1] <= _MAX_HEADING_RATIO * self.untuned[1]

    def record(self) -> dict[str, Any]:
        """JSON data with six significant digits."""
        figures = (*self.untuned, *self.fitted)
        u0, u1, f0, f1 = (float(f"{value:.6g}") for value in figures)
        return {
            "drives": self.drives,
            "windows": self.windows,
            "untuned": {"place_m": u0, "heading_rad": u1},
            "fitted": {"place_m": f0, "heading_rad": f1},
            "position_error_ratio": self.ratio.as_json(),
            "helps": self.helps,
        }  # fmt: skip


def held_out_error(problem: PredictionError, before: Floats, after: Floats) -> HeldOut:
    """Compare two sets of normalised parameters from the same start states."""
    replays = problem.windows.replays
    errors = []
    for cube in (before, after):
        deviations = problem.predicted(cube)[:, :3] - problem.windows.poses
        squares = np.stack([(deviations[:, :2] ** 2).sum(axis=1), deviations[:, 2] ** 2], axis=1)
        counts = np.diff(replays.first)[:, None]
        errors.append(np.sqrt(np.add.reduceat(squares, replays.first[:-1]) / counts))
    return compared(errors[0], errors[1], replays.drive)


def compared(before: Floats, after: Floats, drives: Integers) -> HeldOut:
    """Compare root mean square errors (w, 2), position and heading, of two predictions.

    `drives` (w,) are the drives of the windows, which are in recording order.
    """
    ratio = _mean_ratio(before[:, 0], after[:, 0], drives)
    untuned, fitted = (np.sqrt((table**2).mean(axis=0)).tolist() for table in (before, after))
    return HeldOut(np.unique(drives).size, len(before), tuple(untuned), tuple(fitted), ratio)


def _mean_ratio(before: Floats, after: Floats, drives: Integers) -> Interval:
    """Geometric mean over the drives of the ratio of their mean errors (w,), after to before."""
    _, codes = np.unique(drives, return_inverse=True)
    sums = np.stack([np.bincount(codes, errors) for errors in (after, before)])
    logs = np.log(np.maximum(sums[0], _TINY) / np.maximum(sums[1], _TINY))
    left_out = (logs.sum() - logs) / max(logs.size - 1, 1)
    found = of_units(float(logs.mean()), left_out, unit="held-out drives")
    low, value, high = (math.exp(log) for log in (found.low, found.value, found.high))
    return replace(found, low=low, value=value, high=high)
