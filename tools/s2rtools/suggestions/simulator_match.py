"""The mismatch of sim images with real ones as the cost of a search; intervals of fitted values."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import Interval, of_units
from s2rstore.reader import Store
from s2rstore.records import Domain, Run
from s2rtools.adjustments import Chain
from s2rtools.precompute.frame_reader import Renderers
from s2rtools.suggestions import image_mismatch
from s2rtools.suggestions.held_out_split import SplitPart
from s2rtools.suggestions.objective import Floats, Values
from s2rtools.suggestions.side_images import Adjusted, SideImages
from s2rtools.suggestions.sliders import Slider, changed_chain
from s2rtools.synthetic_world.stored_world import no_renderer_reason

_SEARCH_PIXELS = 64
"""Columns of images that are rendered for the search; the judgement takes whole frames."""
_STEP = 0.01
"""Share of a slider's range by which derivatives are taken."""
_STEPS = 4


class SimulatorMatch:
    """Mismatch of the sim images under changed adjustments with the real images of the run."""

    def __init__(self, store: Store, run: Run, fit: SplitPart, judge: SplitPart) -> None:
        self._store, self._run = store, run
        channels = store.models[run.network("suggestions")].channels
        self._channels: image_mismatch.Channels = channels  # type: ignore[assignment]
        self._weights = image_mismatch.weights(self._channels)
        renderers: Renderers = {}
        self._fit_part = fit
        rendered = no_renderer_reason(store) is None
        stride = max(1, store.dataset.frame_width // _SEARCH_PIXELS) if rendered else 1
        self._fit = _Pairs(store, run, fit.iids, renderers, self._channels, stride, rendered)
        self._whole = _Pairs(store, run, fit.iids, renderers, self._channels)
        self._judge = _Pairs(store, run, judge.iids, renderers, self._channels)

    @property
    def sim_images(self) -> SideImages:
        """The sim images of the judgement."""
        return self._judge.sim

    def fitted(self, values: Values) -> Floats:
        return image_mismatch.cost(self._fit.residuals(self._chain(values)), self._weights)

    def judged(self, values: Values) -> Floats:
        return image_mismatch.cost(self._judge.residuals(self._chain(values)), self._weights)

    def refined(
        self, values: Values, sliders: Sequence[Slider],
        has_time: Callable[[int], bool] = lambda costs: True,
    ) -> dict[str, float]:  # fmt: skip
        """Values after steps of Gauss and Newton on whole frames of the fit.

        `values` names all of `sliders`. A step that does not lower the cost is not made, and none
        after `has_time` says that there is no time for as many costs on whole frames as it takes.
        """
        costs_of_a_step = 2 * len(sliders) + 2
        if not has_time(costs_of_a_step + 1):
            return dict(values)
        present = dict(values)
        lowest = self.whole_cost(present)
        for _ in range(_STEPS):
            if not has_time(costs_of_a_step):
                break
            normal, slope = self._normal_equations(present, sliders)
            step = -_solved(normal.sum(axis=0)[None], slope.sum(axis=0)[None])[0]
            moved = {
                slider.name: slider.value(slider.position(present[slider.name] + change))
                for slider, change in zip(sliders, step.tolist(), strict=True)
            }
            cost = self.whole_cost(moved)
            if not cost < lowest:
                break
            present, lowest = moved, cost
        return present

    def intervals(self, values: Values, sliders: Sequence[Slider]) -> dict[str, Interval]:
        """Intervals of the fitted values of `sliders`, all of which `values` names.

        They follow from the values without each unit of the fit, by one step of Gauss and Newton
        with the derivatives and robust weights at the values.
        """
        normal, slope = self._normal_equations(values, sliders)
        left_out = -_solved(normal.sum(axis=0) - normal, slope.sum(axis=0) - slope)
        return {
            slider.name: of_units(values[slider.name], column, unit="blocks of instances")
            for slider, column in zip(sliders, left_out.T, strict=True)
        }

    def whole_cost(self, values: Values) -> float:
        """Mean cost on whole frames of the fit."""
        residuals = self._whole.residuals(self._chain(values))
        return float(image_mismatch.cost(residuals, self._weights).mean())

    def _normal_equations(self, values: Values, sliders: Sequence[Slider]) -> tuple[Floats, Floats]:
        """Matrices (B, p, p) and slopes (B, p) of the robust cost, summed over each unit."""
        present = self._whole.residuals(self._chain(values))
        derivatives = np.stack(
            [self._derivative(values, slider) for slider in sliders], axis=-1
        )  # (n, m, p)
        weight = self._weights / np.sqrt(1 + np.square(present))
        weighted = derivatives * weight[..., None]
        normal = np.swapaxes(weighted, 1, 2) @ derivatives
        slope = (weighted * present[..., None]).sum(axis=1)
        units = self._fit_part.unit_blocks
        return units.sums(normal), units.sums(slope)

    def _derivative(self, values: Values, slider: Slider) -> Floats:
        """Central differences (n, m) of the residuals by the value of a slider."""
        step = _STEP * (slider.high - slider.low)
        low = max(values[slider.name] - step, slider.low)
        high = min(values[slider.name] + step, slider.high)
        after, before = (
            self._whole.residuals(self._chain({**values, slider.name: value}))
            for value in (high, low)
        )
        return (after - before) / (high - low)

    def _chain(self, values: Values) -> Chain:
        return changed_chain(self._store, self._run, "sim", values)


class _Pairs:
    """Sim and real images of some instances; the real ones do not change."""

    def __init__(
        self, store: Store, run: Run, iids: NDArray[np.int64], renderers: Renderers,
        channels: image_mismatch.Channels, stride: int = 1, rendered: bool = False,
    ) -> None:  # fmt: skip
        self.sim = SideImages(store, run, "sim", iids, renderers, stride, rendered)
        self._channels: image_mismatch.Channels = channels
        self._sim_domain = store.domain(run.sim_domain)
        real = SideImages(store, run, "real", iids, renderers, stride)
        domain = store.domain(run.real_domain)
        self._real = [_metric(made, domain) for _, made in real.adjusted(run.real_adjustments)]

    def residuals(self, chain: Chain) -> Floats:
        """As `image_mismatch.residuals`, (n, m)."""
        parts = [
            image_mismatch.residuals(_metric(made, self._sim_domain), real, self._channels)
            for (_, made), real in zip(self.sim.adjusted(chain), self._real, strict=True)
        ]
        return np.concatenate(parts)


def _metric(images: Adjusted, domain: Domain) -> image_mismatch.Images:
    rgb, depth, valid = images
    return rgb, depth.astype(np.float32) * np.float32(domain.depth_scale), valid


def _solved(normal: Floats, slope: Floats) -> Floats:
    """Solutions (r, p) of the normal equations (r, p, p); nearly singular ones stay small."""
    size = normal.shape[-1]
    ridge = 1e-9 * np.trace(normal, axis1=-2, axis2=-1)[:, None, None] * np.eye(size) + 1e-300
    return np.asarray(np.linalg.solve(normal + ridge, slope[..., None])[..., 0])
