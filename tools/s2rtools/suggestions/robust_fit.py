"""Fit values of sliders to image pairs by robust least squares, with intervals of the values."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from s2rstore.intervals import LEVEL, Interval, of_units
from s2rtools.common.blocks import Blocks
from s2rtools.suggestions import image_mismatch
from s2rtools.suggestions.objective import Floats, Values
from s2rtools.suggestions.sliders import Slider

Residuals = Callable[[Values], Floats]
"""The residuals (n, m) of `image_mismatch` under values of sliders."""
_STEP = 0.01
"""Share of a slider's range by which derivatives are taken."""
_STEPS = 4
_DAMPING = (0.0, 0.01, 0.1, 1.0)
"""Levenberg's and Marquardt's damping of the tries of a step, relative to the diagonal."""


class RobustFit:
    """The robust cost of image pairs as a function of sliders; `units` are independent of another.

    `weights` (m,) are those of the columns of the residuals.
    """

    def __init__(self, residuals: Residuals, weights: Floats, units: Blocks) -> None:
        self._residuals, self._weights, self._units = residuals, weights, units

    def costs(self, values: Values) -> Floats:
        """Cost (n,) of each image pair."""
        return image_mismatch.cost(self._residuals(values), self._weights)

    def cost(self, values: Values) -> float:
        """Mean cost."""
        return float(self.costs(values).mean())

    def refined(
        self, values: Values, sliders: Sequence[Slider],
        has_time: Callable[[int], bool] = lambda costs: True, steps: int = _STEPS,
        least: float = 0.0,
    ) -> dict[str, float]:  # fmt: skip
        """Values after steps of Gauss and Newton, damped where they do not lower the cost.

        `sliders` are the ones that change. The steps end where none lowers the cost by more than
        the share `least`, and where `has_time` says that there is no time for as many costs as the
        next one takes.
        """
        costs_of_a_step = 2 * len(sliders) + 2
        present = dict(values)
        if not sliders or not has_time(costs_of_a_step + 1):
            return present
        lowest = self.cost(present)
        for _ in range(steps):
            if not has_time(costs_of_a_step):
                break
            normal, slope = self._normal_equations(present, sliders)
            before, matrix, gradient = lowest, normal.sum(axis=0), slope.sum(axis=0)
            for damping in _DAMPING:
                moved = self._moved(present, sliders, matrix, gradient, damping)
                if moved == present or (damping and not has_time(1)):
                    break
                cost = self.cost(moved)
                if cost < lowest:
                    present, lowest = moved, cost
                    break
            if not lowest < before * (1 - least):
                break
        return present

    def intervals(
        self, values: Values, sliders: Sequence[Slider], level: float = LEVEL
    ) -> dict[str, Interval]:
        """Intervals of the fitted values of `sliders`, all of which `values` names.

        They follow from the values without each unit of the fit, by one step of Gauss and Newton
        with the derivatives and robust weights at the values. A slider that changes no image has no
        bounds.
        """
        normal, slope = self._normal_equations(values, sliders)
        left_out = -_solved(normal.sum(axis=0) - normal, slope.sum(axis=0) - slope)
        effects = np.diag(normal.sum(axis=0))
        return {
            slider.name: _interval(slider, values[slider.name], steps, effect, level)
            for slider, steps, effect in zip(sliders, left_out.T, effects.tolist(), strict=True)
        }

    def _moved(
        self, values: Values, sliders: Sequence[Slider], normal: Floats, slope: Floats,
        damping: float,
    ) -> dict[str, float]:  # fmt: skip
        """Values after one step from the equations (p, p) and (p,), within the sliders' ranges."""
        damped = normal + damping * np.diag(np.diag(normal))
        step = -_solved(damped[None], slope[None])[0]
        moved = dict(values)
        for slider, change in zip(sliders, step.tolist(), strict=True):
            value = values[slider.name] + change * (slider.high - slider.low)
            moved[slider.name] = slider.value(slider.position(value))
        return moved

    def _normal_equations(self, values: Values, sliders: Sequence[Slider]) -> tuple[Floats, Floats]:
        """Matrices (B, p, p) and slopes (B, p) of the robust cost, summed over each unit.

        Derivatives are by shares of the sliders' ranges.
        """
        present = self._residuals(values)
        derivatives = np.stack(
            [self._derivative(values, slider) for slider in sliders], axis=-1
        )  # (n, m, p)
        weight = self._weights / np.sqrt(1 + np.square(present))
        weighted = derivatives * weight[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ derivatives
        slope = (weighted * present[..., None]).sum(axis=1)
        return self._units.sums(normal), self._units.sums(slope)

    def _derivative(self, values: Values, slider: Slider) -> Floats:
        """Central differences (n, m) of the residuals by the share of a slider's range."""
        step = _STEP * (slider.high - slider.low)
        low = max(values[slider.name] - step, slider.low)
        high = min(values[slider.name] + step, slider.high)
        after, before = (self._residuals({**values, slider.name: value}) for value in (high, low))
        return (after - before) * ((slider.high - slider.low) / (high - low))


def _interval(slider: Slider, value: float, steps: Floats, effect: float, level: float) -> Interval:
    """The interval of a value from the steps (B,) to those without each unit, of its range."""
    if effect == 0:
        return Interval.unknown(value, "no image changes with it")
    if np.ptp(steps) == 0:
        return Interval(value, value, value, level)
    left_out = value + steps * (slider.high - slider.low)
    return of_units(value, left_out, unit="blocks of instances", level=level)


def _solved(normal: Floats, slope: Floats) -> Floats:
    """Solutions (r, p) of the normal equations (r, p, p); nearly singular ones stay small."""
    size = normal.shape[-1]
    ridge = 1e-9 * np.trace(normal, axis1=-2, axis2=-1)[:, None, None] * np.eye(size) + 1e-300
    return np.asarray(np.linalg.solve(normal + ridge, slope[..., None])[..., 0])
