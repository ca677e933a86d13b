"""Adjustments of what a side looks at; neutral ones change nothing, to the bit.

`ADJUSTMENTS` lists them: adding one is a declaration in a file here and a line in that table.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.records import Side
from s2rtools.adjustments import camera, colour, depth, erase
from s2rtools.adjustments.adjustment import Adjustment, ImageAdjustment, RenderedAdjustment

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
        colour.BRIGHTNESS,
        colour.CONTRAST,
        colour.TEMPERATURE,
        depth.DEPTH_RANGE,
        depth.DEPTH_BLUR,
        erase.BLACK,
        camera.HEIGHT,
        camera.PITCH,
        camera.FOV,
    )
}

Chain = Sequence[Mapping[str, Any]]


def apply_chain(
    rgb: NDArray[np.uint8], depth_raw: NDArray[Any], valid: NDArray[np.bool_], chain: Chain
) -> tuple[NDArray[np.uint8], NDArray[Any]]:
    """Apply the image adjustments of a chain in order to a batch.

    rgb (B, H, W, 3) uint8, depth_raw (B, H, W) and its validity; gives both images in the same
    types. With neutral values the very same arrays come back. What needs a renderer is passed
    over: the images are those that it took.
    """
    for step in chain:
        adjustment = _find_adjustment(str(step["name"]))
        if not isinstance(adjustment, ImageAdjustment):
            continue
        if float(step["value"]) != adjustment.neutral:
            rgb, depth_raw = adjustment.apply(rgb, depth_raw, valid, float(step["value"]))
    return rgb, depth_raw


def make_chain(side: Side, values: Mapping[str, float]) -> list[dict[str, Any]]:
    """The chain that a side's values make, in the order of `ADJUSTMENTS`, neutral ones left out.

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
    """`real:brightness=1.15,contrast=1.1` -> {"real": [{"name": ..., "value": ...}, ...]}.

    One side per text; `black` alone means `black=1`. Raises RequestError naming
    the step, with what could stand there.
    """
    sides: dict[Side, list[dict[str, Any]]] = {"sim": [], "real": []}
    word, colon, rest = text.partition(":")
    side = next((known for known in sides if known == word), None)
    if not colon or side is None:
        raise RequestError(f"--adjust {text!r}: begins with sim: or real:")
    for step in rest.split(","):
        name, equals, number = step.strip().partition("=")
        adjustment = _find_adjustment(name.strip())
        if not equals and adjustment is not erase.BLACK:
            such = adjustment.neutral + adjustment.step
            raise RequestError(f"--adjust {text}: {name} needs a value, such as {name}={such:g}")
        try:
            value = float(number) if equals else adjustment.highest
        except ValueError:
            raise RequestError(f"--adjust {name}={number}: not a number") from None
        _check_value(side, adjustment, value, f"--adjust {name}={number}")
        sides[side].append({"name": adjustment.name, "value": value})
    return {str(side): steps for side, steps in sides.items()}


def _check_value(side: Side, adjustment: Adjustment, value: float, asked: str) -> None:
    if side not in adjustment.sides:
        raise RequestError(f"{asked}: not on the {side} side ({', '.join(adjustment.sides)})")
    if not math.isfinite(value) or not adjustment.lowest <= value <= adjustment.highest:
        span = f"{adjustment.lowest:g} .. {adjustment.highest:g}"
        raise RequestError(f"{asked}: {span} ({adjustment.unit})")


def _find_adjustment(name: str) -> Adjustment:
    if name not in ADJUSTMENTS:
        raise RequestError(f"adjustment {name!r}: one of {', '.join(ADJUSTMENTS)}")
    return ADJUSTMENTS[name]
