"""Adjustments: changes of one side's images or camera, such as brightness or camera height.

Registry: `ADJUSTMENTS` maps an adjustment's name to an `Adjustment`. To add an adjustment, declare
it in a module here and add one line to `ADJUSTMENTS`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.records import Side
from s2rtools.adjustments import camera, image_adjustments
from s2rtools.adjustments.adjustment import (
    Adjustment,
    Depth,
    ImageAdjustment,
    Images,
    Mask,
    RenderedAdjustment,
    Rgb,
)

__all__ = [
    "ADJUSTMENTS",
    "Adjustment",
    "Chain",
    "ImageAdjustment",
    "RenderedAdjustment",
    "apply_chain",
    "make_chain",
    "parse_adjustment",
]

ADJUSTMENTS: dict[str, Adjustment] = {
    adjustment.name: adjustment
    for adjustment in (
        image_adjustments.BRIGHTNESS,
        image_adjustments.CONTRAST,
        image_adjustments.TEMPERATURE,
        image_adjustments.DEPTH_RANGE,
        image_adjustments.DEPTH_BLUR,
        image_adjustments.BLACK,
        camera.HEIGHT,
        camera.PITCH,
        camera.FOV,
    )
}

Chain = Sequence[Mapping[str, Any]]


def apply_chain(rgb: Rgb, depth_raw: Depth, valid: Mask, chain: Chain) -> Images:
    """Apply the image adjustments of a chain in order to a batch.

    Takes rgb (B, H, W, 3) uint8, depth_raw (B, H, W) and its validity; returns both images in the
    same types. Neutral values return the same arrays. Adjustments that need a renderer are
    skipped, because the rendered images already contain them.
    """
    for step in chain:
        adjustment = _find_adjustment(str(step["name"]))
        if not isinstance(adjustment, ImageAdjustment):
            continue
        if float(step["value"]) != adjustment.neutral:
            rgb, depth_raw = adjustment.apply(rgb, depth_raw, valid, float(step["value"]))
    return rgb, depth_raw


def make_chain(side: Side, values: Mapping[str, float]) -> list[dict[str, Any]]:
    """Chain of one side from values by name, in the order of `ADJUSTMENTS`, without neutral values.

    Raises RequestError for unknown names and values out of range.
    """
    for name, value in values.items():
        _check_value(side, _find_adjustment(name), float(value), f"{name}={value:g}")
    return [
        {"name": name, "value": round(float(values[name]), 6)}
        for name, adjustment in ADJUSTMENTS.items()
        if name in values and float(values[name]) != adjustment.neutral
    ]


def parse_adjustment(text: str) -> dict[str, list[dict[str, Any]]]:
    """Parse `real:brightness=1.15,contrast=1.1` to {"real": [{"name": ..., "value": ...}, ...]}.

    One side per text; `black` alone means `black=1`. Raises RequestError naming the step and the
    allowed values.
    """
    sides: dict[Side, list[dict[str, Any]]] = {"sim": [], "real": []}
    prefix, colon, rest = text.partition(":")
    side = next((name for name in sides if name == prefix), None)
    if not colon or side is None:
        raise RequestError(f"--adjust {text!r}: must begin with sim: or real:")
    for step in rest.split(","):
        name, equals, number = step.strip().partition("=")
        adjustment = _find_adjustment(name.strip())
        if not equals and adjustment is not image_adjustments.BLACK:
            example = f"{name}={adjustment.neutral + adjustment.step:g}"
            raise RequestError(f"--adjust {text}: {name} needs a value, such as {example}")
        try:
            value = float(number) if equals else adjustment.highest
        except ValueError:
            raise RequestError(f"--adjust {name}={number}: not a number") from None
        _check_value(side, adjustment, value, f"--adjust {name}={number}")
        sides[side].append({"name": adjustment.name, "value": value})
    return {str(side): steps for side, steps in sides.items()}


def _check_value(side: Side, adjustment: Adjustment, value: float, request: str) -> None:
    if side not in adjustment.sides:
        raise RequestError(f"{request}: not on the {side} side ({', '.join(adjustment.sides)})")
    if not math.isfinite(value) or not adjustment.lowest <= value <= adjustment.highest:
        allowed = f"{adjustment.lowest:g} .. {adjustment.highest:g}"
        raise RequestError(f"{request}: allowed are {allowed} ({adjustment.unit})")


def _find_adjustment(name: str) -> Adjustment:
    if name not in ADJUSTMENTS:
        raise RequestError(f"adjustment {name!r}: one of {', '.join(ADJUSTMENTS)}")
    return ADJUSTMENTS[name]
