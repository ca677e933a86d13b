"""The adjustments that a search may change: their factor, range of search and screened values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Run, Side
from s2rtools.adjustments import ADJUSTMENTS, TranslatorAdjustment, make_chain, with_hashes
from s2rtools.adjustments.adjustment import Adjustment
from s2rtools.synthetic_world.stored_world import no_renderer_reason

CAMERA, LIGHTS, EXPOSURE, DEPTH, TRANSLATOR = "camera", "lights", "exposure", "depth", "translator"
MOTION = "motion"
FACTORS = {
    "camera_height": CAMERA, "camera_pitch": CAMERA, "camera_fov": CAMERA, "temperature": LIGHTS,
    "lamp_power": LIGHTS, "window_power": LIGHTS,
    "brightness": EXPOSURE, "contrast": EXPOSURE, "vignette": EXPOSURE,
    "depth_range": DEPTH, "depth_blur": DEPTH, "depth_noise": DEPTH, "depth_holes": DEPTH,
    "depth_steps": DEPTH, "motion_blur": MOTION, "rolling_shutter": MOTION,
}  # fmt: skip
"""The factor that each adjustment belongs to; others are factors of their own."""
RANGES = {
    "camera_height": (-0.3, 0.3), "camera_pitch": (-10.0, 10.0), "camera_fov": (-16.0, 16.0),
    "brightness": (0.4, 2.5), "contrast": (0.4, 2.5), "temperature": (-0.6, 0.6),
    "lamp_power": (0.5, 2.0), "window_power": (0.4, 2.0),
    "depth_range": (0.5, 2.0), "depth_blur": (0.0, 4.0), "depth_noise": (0.0, 0.1),
    "depth_holes": (0.0, 0.4), "depth_steps": (0.0, 0.1), "motion_blur": (0.0, 12.0),
    "rolling_shutter": (-8.0, 8.0),
}  # fmt: skip
"""Ranges of search that are narrower than those of the adjustments."""
DEGRADING = ("black", "depth_noise", "depth_holes", "depth_steps", "motion_blur")
"""Adjustments that only remove information, and so are no remedy for real images."""
NEVER = ("black",)
_SCREENED = (-0.3, -0.12, -0.05, 0.05, 0.12, 0.3)
_STRENGTHS = (0.5, 1.0)


@dataclass(frozen=True, slots=True)
class Slider:
    """One adjustment of a side: the value `base` of the run, and the range of search.

    Positions in the unit interval are linear in the value, or in its logarithm for factors.
    """

    name: str
    factor: str
    unit: str
    base: float
    low: float
    high: float
    digits: int
    logarithmic: bool = False
    screened: tuple[float, ...] = ()
    moves_camera: bool = False

    def position(self, value: float) -> float:
        """Where a value lies between the ends of the range, 0 .. 1."""
        low, high, at = self.low, self.high, value
        if self.logarithmic:
            low, high, at = math.log(low), math.log(high), math.log(max(value, self.low))
        return min(max((at - low) / (high - low), 0.0), 1.0)

    def value(self, position: float) -> float:
        """The rounded value at a position; positions outside 0 .. 1 give the ends."""
        at = min(max(position, 0.0), 1.0)
        if self.logarithmic:
            exact = self.low * (self.high / self.low) ** at
        else:
            exact = self.low + at * (self.high - self.low)
        return min(max(round(exact, self.digits), self.low), self.high)

    def screening(self) -> list[float]:
        """The values that are tried one at a time, ascending, without that of the run."""
        values = self.screened
        if not values:
            start = self.position(self.base)
            values = tuple(self.value(start + shift) for shift in _SCREENED)
        return sorted({value for value in values if value != self.base})


def sliders_of(store: Store, run: Run, side: Side) -> list[Slider]:
    """The sliders of one side of a run, in the order of a chain.

    Left out are adjustments that the model's input does not contain, cameras without a renderer
    and on the real side, whose images exist already, and for real images those that only remove
    information. Raises RequestError for a run that has an adjustment twice.
    """
    chain = run.adjustments(side)
    names = [str(step["name"]) for step in chain]
    if len(set(names)) < len(names):
        raise RequestError(f"run {run.run}: applies an adjustment twice; suggest needs one of each")
    base = {str(step["name"]): float(step["value"]) for step in chain}
    channels = store.models[run.network("suggestions")].channels
    left_out = (*NEVER, *DEGRADING) if side == "real" else NEVER
    sliders = []
    for adjustment in ADJUSTMENTS.values():
        if isinstance(adjustment, TranslatorAdjustment):
            sliders += _translators(store, run, side, adjustment, base)
            continue
        if side not in adjustment.sides or not adjustment.changes(channels):
            continue
        if adjustment.name in left_out:
            continue
        if adjustment.needs_renderer and (side == "real" or no_renderer_reason(store) is not None):
            continue
        sliders.append(slider_of(adjustment, base.get(adjustment.name, adjustment.neutral)))
    return sliders


def slider_of(adjustment: Adjustment, base: float) -> Slider:
    """The slider of an adjustment whose value is `base`."""
    low, high = RANGES.get(adjustment.name, (adjustment.lowest, adjustment.highest))
    low, high = min(low, base), max(high, base)
    logarithmic = adjustment.neutral == 1 and low > 0
    digits = max(2, 1 - math.floor(math.log10(adjustment.step)))
    return Slider(
        adjustment.name, FACTORS.get(adjustment.name, adjustment.name), adjustment.unit, base,
        low, high, digits, logarithmic, (), adjustment.needs_renderer,
    )  # fmt: skip


def _translators(
    store: Store, run: Run, side: Side, adjustment: Adjustment, base: Mapping[str, float]
) -> list[Slider]:
    """The strengths of the translators of a side; one translator at most is changed at a time."""
    return [
        Slider(
            f"{adjustment.name}:{record.translator}", TRANSLATOR, adjustment.unit,
            base.get(f"{adjustment.name}:{record.translator}", 0.0), 0.0, 1.0, 2, False, _STRENGTHS,
        )
        for record in store.translators.values()
        if record.source_domain == run.domain(side)
        and record.accepted is not False
        and record.method != "identity"
    ]  # fmt: skip


def changed_chain(
    store: Store, run: Run, side: Side, values: Mapping[str, float]
) -> list[dict[str, Any]]:
    """The chain of a side with new values; adjustments that the run does not have follow its own.

    Raises RequestError for values out of range.
    """
    own: Sequence[Mapping[str, Any]] = run.adjustments(side)
    present = {str(step["name"]) for step in own}
    kept = [
        {**step, "value": float(values.get(str(step["name"]), float(step["value"])))}
        for step in own
    ]  # fmt: skip
    added = {name: value for name, value in values.items() if name not in present}
    return with_hashes([*kept, *make_chain(side, added, store.translators)], store.translators)
