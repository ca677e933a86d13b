"""Adjustments: changes of one side's images or camera, such as brightness or camera height.

Registry: `ADJUSTMENTS` maps an adjustment's name to an `Adjustment`. To add an adjustment, declare
it in a module here and add one line to `_OWN`. A package adds one by an entry point of the group
`s2r.adjustments`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.plugins import Registry, instance_of
from s2rstore.records import Side, TranslatorRecord
from s2rtools.adjustments import camera, image_adjustments, sensor_models, translation
from s2rtools.adjustments.adjustment import (
    Adjustment,
    Depth,
    ImageAdjustment,
    Images,
    Mask,
    RenderedAdjustment,
    Rgb,
    TranslatorAdjustment,
)
from s2rtools.adjustments.translation import apply_translator
from s2rtools.translation.translator_file import open_stored

__all__ = [
    "ADJUSTMENTS",
    "Adjustment",
    "Chain",
    "ImageAdjustment",
    "RenderedAdjustment",
    "TranslatorAdjustment",
    "apply_chain",
    "chain_position",
    "make_chain",
    "parse_adjustment",
    "translator_name",
    "with_hashes",
]

_OWN = (
    translation.TRANSLATE,
    image_adjustments.BRIGHTNESS,
    image_adjustments.CONTRAST,
    image_adjustments.TEMPERATURE,
    image_adjustments.DEPTH_RANGE,
    image_adjustments.DEPTH_BLUR,
    image_adjustments.BLACK,
    image_adjustments.VIGNETTE,
    image_adjustments.DEPTH_NOISE,
    image_adjustments.DEPTH_HOLES,
    sensor_models.DISTORTION,
    sensor_models.MOTION_BLUR,
    sensor_models.ROLLING_SHUTTER,
    sensor_models.DEPTH_STEPS,
    camera.LAMPS,
    camera.WINDOWS,
    camera.HEIGHT,
    camera.PITCH,
    camera.FOV,
)
ADJUSTMENTS = Registry[Adjustment](
    "adjustment", {each.name: each for each in _OWN}, instance_of(Adjustment)
)

Chain = Sequence[Mapping[str, Any]]


def apply_chain(
    rgb: Rgb,
    depth_raw: Depth,
    valid: Mask,
    chain: Chain,
    store_path: Path | None = None,
    enlargement: float = 1.0,
) -> Images:
    """Apply the image adjustments of a chain in order to a batch.

    Takes rgb (B, H, W, 3) uint8, depth_raw (B, H', W') and its validity; returns both images in the
    same types. A value in pixels is one in pixels of the stored frame: the images are `enlargement`
    times as wide. Neutral values return the same arrays. Adjustments that need a renderer are
    skipped, because the rendered images already contain them. Translators are read from the store
    at `store_path`; raises RequestError where one is missing or damaged.
    """
    for step in chain:
        adjustment, value = _find_adjustment(str(step["name"])), float(step["value"])
        if value == adjustment.neutral:
            continue
        if isinstance(adjustment, TranslatorAdjustment):
            if store_path is None:
                raise RequestError(f"{step['name']}: translators need a store")
            stored = open_stored(store_path, str(step["sha256"]))
            rgb, depth_raw = apply_translator(stored, rgb, depth_raw, valid, value)
        elif isinstance(adjustment, ImageAdjustment):
            size = value * enlargement if adjustment.in_pixels else value
            rgb, depth_raw = adjustment.apply(rgb, depth_raw, valid, size)
            if adjustment.moves_pixels:
                valid = depth_raw > 0
    return rgb, depth_raw


def make_chain(
    side: Side,
    values: Mapping[str, float],
    translators: Mapping[str, TranslatorRecord] | None = None,
) -> list[dict[str, Any]]:
    """Chain of one side from values by name, in the order of `ADJUSTMENTS`, without neutral values.

    The strength of a translator T of `translators` has the name `translate:T`. Raises RequestError
    for unknown names and values out of range.
    """
    for name, value in values.items():
        _check_value(side, _find_adjustment(name), float(value), f"{name}={value:g}")
    steps = [
        {"name": name, "value": round(float(value), 6)}
        for name, value in sorted(values.items(), key=lambda item: chain_position(item[0]))
        if float(value) != _find_adjustment(name).neutral
    ]
    return with_hashes(steps, translators or {})


def chain_position(name: str) -> int:
    """Position of an adjustment in chains that are made from sliders."""
    return list(ADJUSTMENTS).index(_find_adjustment(name).name)


def with_hashes(chain: Chain, translators: Mapping[str, TranslatorRecord]) -> list[dict[str, Any]]:
    """The chain with the hash of each translator. Raises RequestError for unknown translators."""
    steps = []
    for step in chain:
        name = translator_name(str(step["name"]))
        if name is None:
            steps.append(dict(step))
            continue
        if name not in translators:
            known = ", ".join(translators) or "none"
            raise RequestError(f"translator {name!r}: not in the store (translators: {known})")
        steps.append({**step, "sha256": translators[name].sha256})
    return steps


def translator_name(name: str) -> str | None:
    """T of the adjustment `translate:T`; None for other adjustments."""
    kind, _, translator = name.partition(":")
    return translator if kind == translation.TRANSLATE.name else None


def parse_adjustment(text: str) -> dict[str, list[dict[str, Any]]]:
    """Parse `real:brightness=1.15,contrast=1.1` to {"real": [{"name": ..., "value": ...}, ...]}.

    One side per text; `black` alone means `black=1`. `translate=T` and `translate=T@0.5` become the
    name `translate:T` with the strength as value. Raises RequestError naming the step and the
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
        label = adjustment.name
        if adjustment is translation.TRANSLATE:
            translator, at, number = number.partition("@")
            if not translator:
                raise RequestError(f"--adjust {text}: translate needs a translator: translate=NAME")
            label, equals = f"{adjustment.name}:{translator}", at
        if not equals and adjustment not in (image_adjustments.BLACK, translation.TRANSLATE):
            example = f"{name}={adjustment.neutral + adjustment.step:g}"
            raise RequestError(f"--adjust {text}: {name} needs a value, such as {example}")
        try:
            value = float(number) if equals else adjustment.highest
        except ValueError:
            raise RequestError(f"--adjust {name}={number}: not a number") from None
        _check_value(side, adjustment, value, f"--adjust {name}={number}")
        sides[side].append({"name": label, "value": value})
    return {str(side): steps for side, steps in sides.items()}


def _check_value(side: Side, adjustment: Adjustment, value: float, request: str) -> None:
    if side not in adjustment.sides:
        raise RequestError(f"{request}: not on the {side} side ({', '.join(adjustment.sides)})")
    if not math.isfinite(value) or not adjustment.lowest <= value <= adjustment.highest:
        allowed = f"{adjustment.lowest:g} .. {adjustment.highest:g}"
        raise RequestError(f"{request}: allowed are {allowed} ({adjustment.unit})")


def _find_adjustment(name: str) -> Adjustment:
    known = name if translator_name(name) is None else translation.TRANSLATE.name
    return ADJUSTMENTS.find(known)
