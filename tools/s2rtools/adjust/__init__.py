"""Adjustments of input images; neutral ones change nothing, to the bit.

`ADJUSTMENTS` lists them: adding one is a declaration in a file here and a line in that table.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.adjust import colour, depth, erase
from s2rtools.adjust.contract import Adjustment

ADJUSTMENTS: dict[str, Adjustment] = {
    adjustment.name: adjustment
    for adjustment in (
        colour.BRIGHTNESS,
        colour.CONTRAST,
        colour.TEMPERATURE,
        depth.DEPTH_RANGE,
        depth.DEPTH_BLUR,
        erase.BLACK,
    )
}

Chain = Sequence[Mapping[str, Any]]


def apply_chain(
    rgb: NDArray[np.uint8], depth_raw: NDArray[Any], valid: NDArray[np.bool_], chain: Chain
) -> tuple[NDArray[np.uint8], NDArray[Any]]:
    """Apply adjustments in order to a batch.

    rgb (B, H, W, 3) uint8, depth_raw (B, H, W) and its validity; gives both images in the same
    types. With neutral values the very same arrays come back.
    """
    for step in chain:
        adjustment = _known(str(step["name"]))
        if float(step["value"]) != adjustment.neutral:
            rgb, depth_raw = adjustment.apply(rgb, depth_raw, valid, float(step["value"]))
    return rgb, depth_raw


def parse(text: str) -> dict[str, list[dict[str, Any]]]:
    """`real:brightness=1.15,contrast=1.1` -> {"real": [{"name": ..., "value": ...}, ...]}.

    One side per text; `black` alone means `black=1`. Raises RequestError naming
    the step, with what could stand there.
    """
    sides: dict[str, list[dict[str, Any]]] = {"sim": [], "real": []}
    side, colon, rest = text.partition(":")
    if not colon or side not in sides:
        raise RequestError(f"--adjust {text!r}: begins with sim: or real:")
    for step in rest.split(","):
        name, equals, number = step.strip().partition("=")
        adjustment = _known(name.strip())
        try:
            value = float(number) if equals else adjustment.highest
        except ValueError:
            raise RequestError(f"--adjust {name}={number}: not a number") from None
        if not math.isfinite(value) or not adjustment.lowest <= value <= adjustment.highest:
            span = f"{adjustment.lowest:g} .. {adjustment.highest:g}"
            raise RequestError(f"--adjust {name}={number}: {span} ({adjustment.unit})")
        sides[side].append({"name": adjustment.name, "value": value})
    return sides


def _known(name: str) -> Adjustment:
    if name not in ADJUSTMENTS:
        raise RequestError(f"adjustment {name!r}: one of {', '.join(ADJUSTMENTS)}")
    return ADJUSTMENTS[name]
