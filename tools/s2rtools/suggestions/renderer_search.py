"""Fit the parameters of a renderer program to real images, and judge them on held-out images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.intervals import Interval, simultaneous_level
from s2rstore.reader import Store
from s2rtools.common.command_line.progress import Reporter
from s2rtools.simulated_frames.pose_renderer import FrameCameras, PoseRenderer
from s2rtools.suggestions import image_mismatch
from s2rtools.suggestions.held_out_split import SplitPart, split
from s2rtools.suggestions.objective import Floats, Values
from s2rtools.suggestions.renderer_match import (
    RenderedFrames,
    adjustment_sliders,
    parameter_slider,
)
from s2rtools.suggestions.robust_fit import RobustFit
from s2rtools.suggestions.settings import SuggestSettings, TimeBudget
from s2rtools.suggestions.sliders import Slider

_FEW = 8
"""Instances on which the search begins."""
_STARTS = 3
"""Values from which the search begins: the best single changes, and the defaults."""
_SOLVED = 0.05
"""Share of the mismatch that is left where the search begins from no other values."""
_FEW_STEPS, _STEPS = 12, 8
_LEAST_STEP = 0.002
"""Share of the mismatch that a step of the search has to remove."""
_LEAST_RANGE = 0.005
"""Half of the narrowest range, as a share of the declared one: images do not tell less apart."""
_LEAST_MISMATCH = 1e-6
_SET = "parameter set"
"""The step of the budget that is timed: the frames of the fit for a set of values."""


@dataclass(frozen=True, slots=True)
class FittedValue:
    """A parameter or an image adjustment: its value, and the range to draw it from.

    Where the range holds the default, it is unchanged and the default is its value.
    """

    name: str
    unit: str
    default: float
    value: float
    range: Interval

    @property
    def changed(self) -> bool:
        return self.value != self.default

    def as_json(self) -> dict[str, Any]:
        """The value as JSON data."""
        return {"name": self.name, "unit": self.unit, "default": self.default, "value": self.value,
                "changed": self.changed, "range": self.range.as_json()}  # fmt: skip


@dataclass(frozen=True, slots=True)
class RendererReport:
    """The values with which a renderer fits the real images of a domain.

    `before` and `after` are the mean mismatches of held-out images with the defaults and with the
    values, `lowered` is the share of `before` that the values remove. `frames` is the number of
    frames that were compared.
    """

    renderer: str
    version: str
    domain: str
    before: float
    after: float
    lowered: Interval
    parameters: tuple[FittedValue, ...]
    adjustments: tuple[FittedValue, ...]
    fitted_instances: int
    judged_instances: int
    frames: int
    complete: bool

    @property
    def changed(self) -> tuple[FittedValue, ...]:
        """The parameters and adjustments that are not at their defaults."""
        return tuple(each for each in (*self.parameters, *self.adjustments) if each.changed)

    @property
    def helps(self) -> bool:
        """Whether something is changed and lowers the mismatch of held-out images.

        Evidently, where these are enough for an interval.
        """
        lowered = self.lowered
        lower = lowered.is_positive if lowered.is_known else lowered.value > 0
        return bool(self.changed) and lower

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The range to draw each parameter and adjustment from."""
        fitted = (*self.parameters, *self.adjustments)
        return {each.name: (round(each.range.low, 6), round(each.range.high, 6)) for each in fitted}

    def as_json(self) -> dict[str, Any]:
        """The report as JSON data."""
        return {
            "renderer": self.renderer, "version": self.version, "domain": self.domain,
            "ranges": self.ranges,
            "parameters": [each.as_json() for each in self.parameters],
            "adjustments": [each.as_json() for each in self.adjustments],
            "mismatch_before": round(self.before, 6), "mismatch_after": round(self.after, 6),
            "lowered": self.lowered.as_json(), "fitted_instances": self.fitted_instances,
            "judged_instances": self.judged_instances, "frames": self.frames,
            "complete": self.complete, "helps": self.helps,
        }  # fmt: skip


def suggest_parameters(
    root: Path, command: Sequence[str], frames: Path, workers: int, timeout: float,
    settings: SuggestSettings, reporter: Reporter,
) -> RendererReport:  # fmt: skip
    """Fit what a program declares, and image adjustments, to the real images of a store.

    The folder `frames` keeps what is rendered. Raises RequestError where the store has no real
    images with poses or the program cannot be used, InconclusiveError where its instances are too
    few.
    """
    budget = TimeBudget(settings.budget)
    with s2rstore.open(root) as store:
        store.require_poses("suggest")
        domain = next((name for name in store.domains if store.domain(name).kind == "real"), None)
        if domain is None:
            raise RequestError(f"{root}: has no real images to fit a renderer to")
        parts = split(
            store, store.imaged(domain), settings.frames, settings.judged,
            f"domain {domain} has #",
        )  # fmt: skip
        cameras = FrameCameras.of_store(store, None)
        with PoseRenderer(frames, command, cameras, workers, timeout) as renderer:
            if not renderer.ready.parameters:
                raise RequestError(f"renderer {renderer.ready.name}: declares no parameters")
            return _Search(store, domain, renderer, settings, parts, budget, reporter).report()


class _Search:
    """The fit of one program, and what it is judged on.

    Geometry and colours are fitted without depth noise, whose figure changes erratically with them.
    Sliders that mainly change the noise are fitted after the others.
    """

    def __init__(
        self, store: Store, domain: str, renderer: PoseRenderer, settings: SuggestSettings,
        parts: tuple[SplitPart, SplitPart], budget: TimeBudget, reporter: Reporter,
    ) -> None:  # fmt: skip
        self._renderer, self._settings, self._domain = renderer, settings, domain
        self._fit, self._judge = parts
        self._budget, self._reporter, self._complete = budget, reporter, True
        parameters = renderer.ready.parameters
        self._parameters = [parameter_slider(each) for each in parameters
                            if each.minimum < each.maximum]  # fmt: skip
        self._defaults = {slider.name: slider.base for slider in self._parameters}
        few = self._fit.thinned(_FEW)
        compared = [RenderedFrames(store, domain, renderer, part.iids)
                    for part in (few, self._fit, self._judge)]  # fmt: skip
        channels = compared[0].channels
        self._adjustments = adjustment_sliders(channels, {each.name for each in parameters})
        self._compared = compared
        images, all_kinds = (image_mismatch.weights(channels, noise) for noise in (False, True))
        self._few, self._few_whole = (
            RobustFit(compared[0].residuals, each, few.unit_blocks) for each in (images, all_kinds)
        )
        self._images, self._whole = (
            RobustFit(self._timed, weights, self._fit.unit_blocks)
            for weights in (images, all_kinds)
        )
        self._held_out = RobustFit(compared[2].residuals, all_kinds, self._judge.unit_blocks)
        self._noise_sliders: set[str] = set()

    def report(self) -> RendererReport:
        """Search, and judge what was found on the held-out instances."""
        before = self._held_out.costs(self._defaults)
        values, sliders = self._defaults, list(self._parameters)
        if before.mean() > _LEAST_MISMATCH:
            self._whole.cost(values)
            values = self._fit_parameters()
            values, sliders = self._add_adjustments(values, before)
        values, ranges = self._ranges(values, sliders)
        after = self._held_out.costs(values)
        ready, count = self._renderer.ready, len(self._parameters)
        fitted = tuple(
            FittedValue(slider.name, slider.unit, slider.base, values[slider.name],
                        ranges[slider.name])
            for slider in sliders
        )  # fmt: skip
        return RendererReport(
            ready.name, ready.version, self._domain, float(before.mean()), float(after.mean()),
            self._judge.share_of_decrease(before, after), fitted[:count], fitted[count:],
            int(self._fit.iids.size), int(self._judge.iids.size),
            sum(each.compared for each in self._compared), self._complete,
        )  # fmt: skip

    def _timed(self, values: Values) -> Floats:
        """Residuals of the instances of the fit."""
        with self._budget.step(_SET):
            return self._compared[1].residuals(values)

    def _has_time(self, costs: int) -> bool:
        """Whether some sets can be rendered before the ranges and the judgement have to begin."""
        reserve = 2 * len(self._parameters) + 2 + self._judge.iids.size / self._fit.iids.size
        seconds = self._budget.seconds(_SET)
        fits = self._budget.fits(_SET, (costs - 1 + reserve) * seconds)
        self._complete = self._complete and fits
        return fits

    def _fit_parameters(self) -> dict[str, float]:
        """The parameters that fit best, without image adjustments."""
        tried = [
            (slider.name, {**self._defaults, slider.name: value})
            for slider in self._parameters
            for value in slider.screening()
        ]
        self._reporter.begin("try single parameters", len(tried))
        start, all_kinds = self._few.cost(self._defaults), self._few_whole.cost(self._defaults)
        ranked: list[tuple[float, dict[str, float]]] = []
        effects = {slider.name: (0.0, 0.0) for slider in self._parameters}
        for name, values in tried:
            if not self._has_time(1):
                break
            cost = self._few.cost(values)
            ranked.append((cost, values))
            images, noise = abs(cost - start), abs(self._few_whole.cost(values) - all_kinds)
            effects[name] = max(effects[name][0], images), max(effects[name][1], noise)
            self._reporter.advance(1)
        self._noise_sliders = {name for name, (images, noise) in effects.items()
                               if noise > 2 * images}  # fmt: skip
        fitted = [each for each in self._parameters if each.name not in self._noise_sliders]
        better = [values for cost, values in sorted(ranked, key=lambda each: each[0])
                  if cost < start]  # fmt: skip
        self._reporter.begin("fit parameters", _STARTS + 1)
        best = self._defaults
        for values in [*better[:1], self._defaults, *better[1:]][:_STARTS]:
            found = self._refined(self._few, values, fitted, _FEW_STEPS)
            best = min(best, found, key=self._few.cost)
            self._reporter.advance(1)
            if self._few.cost(best) < _SOLVED * start:
                break
        return self._refit(best, self._parameters)

    def _refined(
        self, fit: RobustFit, values: Values, sliders: Sequence[Slider], steps: int = _STEPS
    ) -> dict[str, float]:
        return fit.refined(values, sliders, self._has_time, steps, _LEAST_STEP)

    def _refit(self, values: Values, sliders: Sequence[Slider]) -> dict[str, float]:
        """Values fitted together: first those of the images, then those of the noise."""
        noise = [slider for slider in sliders if slider.name in self._noise_sliders]
        others = [slider for slider in sliders if slider.name not in self._noise_sliders]
        return self._refined(self._whole, self._refined(self._images, values, others), noise)

    def _add_adjustments(
        self, values: dict[str, float], before: Floats
    ) -> tuple[dict[str, float], list[Slider]]:
        """Values with the image adjustments that gain their price, and the sliders of them all.

        `before` are the costs of the held-out instances with the defaults.
        """
        sliders, left = list(self._parameters), list(self._adjustments)
        price = self._settings.price * self._whole.cost(self._defaults)
        judged = self._held_out.costs(values)
        self._reporter.begin("try image adjustments", self._settings.changes)
        for _ in range(self._settings.changes):
            present = self._whole.cost(values)
            if present < price or not self._has_time(1):
                break
            tried = [
                ({**values, slider.name: value}, slider)
                for slider in left
                for value in slider.screening()
            ]
            best, slider = min(tried, key=lambda each: self._whole.cost(each[0]))
            gain = present - self._whole.cost(best)
            if gain <= 0:
                break
            if self._images.cost(values) - self._images.cost(best) < gain / 2:
                self._noise_sliders.add(slider.name)
            widened = self._refit(best, [*sliders, slider])
            after = self._held_out.costs(widened)
            if present - self._whole.cost(widened) < price:
                break
            if not self._judge.mean(judged - after).is_positive:
                break
            values, judged, sliders = widened, after, [*sliders, slider]
            left.remove(slider)
            self._reporter.advance(1)
        return values, sliders

    def _ranges(
        self, values: dict[str, float], sliders: Sequence[Slider]
    ) -> tuple[dict[str, float], dict[str, Interval]]:
        """Values and ranges; a value whose range holds its default becomes the default."""
        level = simultaneous_level(len(sliders))
        ranges: dict[str, Interval] = {}
        free = list(sliders)
        while free:
            for fit, is_noise in ((self._images, False), (self._whole, True)):
                own = [each for each in free if (each.name in self._noise_sliders) == is_noise]
                if own:
                    found = fit.intervals(values, own, level)
                    ranges |= {each.name: _range(found[each.name], each) for each in own}
            moved = [
                each for each in free
                if not ranges[each.name].low <= each.base <= ranges[each.name].high
            ]  # fmt: skip
            if len(moved) == len(free):
                break
            values = values | {each.name: each.base for each in free if each not in moved}
            free = moved
            values = self._refit(values, free)
        return values, ranges


def _range(found: Interval, slider: Slider) -> Interval:
    """An interval of a value as a range to draw from, within what the slider allows.

    Where the images do not tell the value, it is all that the slider allows.
    """
    if not found.is_known:
        return replace(found, low=slider.low, high=slider.high, reason="")
    least = _LEAST_RANGE * (slider.high - slider.low)
    low, high = min(found.low, found.value - least), max(found.high, found.value + least)
    return replace(found, low=low, high=high).clipped(slider.low, slider.high)
