"""Windowed prediction error of a simulator, as least squares over its parameters.

Each window restarts from the measured real state. Its five numbers are estimated along with the
parameters: every evaluation eliminates them linearly (variable projection; Golub and Pereyra 1973),
which takes two more replays and leaves residuals that depend on the parameters alone. A weak prior
about the measured state keeps windows at rest determined.
"""

from __future__ import annotations

import numpy as np

from s2rtools.sysid.parameter_space import Space
from s2rtools.sysid.simulators.simulator import Floats
from s2rtools.sysid.variable_projection import eliminate
from s2rtools.sysid.windows import SysidWindows

_DOUBT = np.array([0.02, 0.02, 0.02, 0.15, 0.3])
"""Standard deviation of measured start states, generous: m, m, rad, m/s, rad/s."""
_FD_STEP = np.array([1e-4, 1e-4])
_STEP = 1e-3
"""Step of the numerical derivatives, in the unit cube."""
_WORST = 1e12


class PredictionError:
    """Residuals over `space`, in units of `sigma` (3,): m, m, rad."""

    def __init__(self, space: Space, windows: SysidWindows, sigma: Floats | None = None,
                 starts: Floats | None = None) -> None:  # fmt: skip
        self.space, self.windows = space, windows
        self.sigma = np.array(windows.noise if sigma is None else sigma)
        self.starts = windows.starts if starts is None else starts

    def __len__(self) -> int:
        return 3 * len(self.windows.replays.times)

    def of(self, windows: SysidWindows) -> PredictionError:
        """The same problem on other windows, from their measured starts."""
        return PredictionError(self.space, windows, self.sigma)

    def over(self, space: Space) -> PredictionError:
        """The same problem in another space."""
        return PredictionError(space, self.windows, self.sigma, self.starts)

    def weighted(self, sigma: Floats) -> PredictionError:
        return PredictionError(self.space, self.windows, sigma, self.starts)

    def residuals(self, cube: Floats) -> Floats:
        """Residuals (n, 3) in units of `sigma`, with the best start states."""
        return self._eliminated(cube)[0]

    def cost(self, cube: Floats) -> float:
        """Mean square residual with the best start states; always finite."""
        mean = self._eliminated(cube)[2] / len(self)
        return mean if np.isfinite(mean) else _WORST

    def restarted(self, cube: Floats) -> PredictionError:
        """The same problem, linearised at the start states that fit best."""
        starts = self.starts + self._eliminated(cube)[1]
        return PredictionError(self.space, self.windows, self.sigma, starts)

    def jacobian(self, cube: Floats) -> Floats:
        """Derivatives of `residuals` by the coordinates, (n, 3, p); one-sided at a range limit."""
        columns = []
        for i in range(len(cube)):
            low, high = cube.copy(), cube.copy()
            low[i], high[i] = max(cube[i] - _STEP, 0.0), min(cube[i] + _STEP, 1.0)
            change = self.residuals(high) - self.residuals(low)
            columns.append(change / (high[i] - low[i]))
        return np.stack(columns, axis=-1)

    def predicted(self, cube: Floats) -> Floats:
        """States (n, 5) simulated from the measured starts."""
        values = self.space.values(cube)
        return self.space.simulator.replay(values, self.windows.replays, self.windows.starts)

    def _eliminated(self, cube: Floats) -> tuple[Floats, Floats, float]:
        """Residuals, corrections of the starts (w, 5) and the sum of squares."""
        values, replays = self.space.values(cube), self.windows.replays
        starts, replay = self.starts, self.space.simulator.replay
        states = replay(values, replays, starts)
        residual = np.ascontiguousarray((states[:, :3] - self.windows.poses) / self.sigma)
        sensitivity = np.zeros((*residual.shape, 5))
        begin = starts[self.windows.window_of_row]
        sensitivity[:, 0, 0] = sensitivity[:, 1, 1] = sensitivity[:, 2, 2] = 1.0
        sensitivity[:, 0, 2] = -(states[:, 1] - begin[:, 1])
        sensitivity[:, 1, 2] = states[:, 0] - begin[:, 0]
        for i, nudge in enumerate(_FD_STEP):
            nudged = starts.copy()
            nudged[:, 3 + i] += nudge
            other = replay(values, replays, nudged)
            sensitivity[:, :, 3 + i] = (other[:, :3] - states[:, :3]) / nudge
        sensitivity /= self.sigma[:, None]
        corrections = np.empty_like(starts)
        if not np.isfinite(residual).all() or not np.isfinite(sensitivity).all():
            return np.full_like(residual, np.sqrt(_WORST)), np.zeros_like(starts), np.inf
        moved = starts - self.windows.starts
        total = eliminate(residual, sensitivity, replays.first, _DOUBT**-2.0, moved, corrections)
        return residual, corrections, float(total)
