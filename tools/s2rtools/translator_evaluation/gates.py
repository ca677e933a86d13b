"""Limits of the content that a translator must keep to be accepted as an adjustment.

The limits lie between maps of colours, which keep all content, and damage. They were chosen on 100
pairs of a synthetic world of rooms and checked on photographs of rooms and of roads, 8 pairs of
domains in all, with `identity`, `grayworld`, `reinhard`, `mkl`, `histogram` and `fda`. Worst
figure of these methods, and best figure of the damage that a limit is for, over all domains:

| metric | methods | damage |
|---|---|---|
| edge_agreement | 0.81 | 0.24 constant, 0.52 shuffled |
| luminance_correlation | 0.86 | -0.98 inverted |
| region_correlation | 0.60 (`fda`) | -0.9 inverted |
| sharpness | 0.96 | 0.84 blur of 1 pixel, 0.76 of 1.5 pixels |
| diversity | 0.93 | 0.00 constant, one repeated image |
| matched, pairing_rank | 1.00, 1.00 | 0.05, 0.64 shuffled |
| invented_share | 0.05 | 0.6 an object of 6 pixels, 0.35 a patch of 8 pixels of another image |

Sizes are for images of 128 to 160 pixels. Not caught: a blur of 0.7 pixels, objects in fewer than
15 % of the images, and objects whose contrast is below a third of that of the image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from s2rtools.translator_evaluation.measures import CONTENT, Content

SHARPNESS_OF_TARGET = (0.8, 1.0)
"""Range to which the target's sharpness is clipped: a translator may blur as much as its target."""


@dataclass(frozen=True, slots=True)
class Check:
    """One metric against its limit; `margin` is positive on the allowed side."""

    metric: str
    value: float
    limit: float
    passed: bool
    margin: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a translator is accepted; `reasons` say in words why not."""

    passed: bool
    reasons: tuple[str, ...]
    checks: tuple[Check, ...]


def judge(content: Content) -> Verdict:
    """Judge the content that a translator keeps. Measures that are unknown are not judged."""
    checks, reasons = [], []
    for measure in CONTENT:
        value = content[measure.name]
        if measure.limit is None or math.isnan(value):
            continue
        limit = measure.limit
        if measure.name == "sharpness" and not math.isnan(content["target_sharpness"]):
            low, high = SHARPNESS_OF_TARGET
            limit *= min(max(content["target_sharpness"], low), high)
        higher = measure.better == "higher"
        margin = value - limit if higher else limit - value
        checks.append(Check(measure.name, value, limit, margin >= 0, margin))
        if margin < 0:
            name = measure.name.replace("_", " ")
            sign = "<" if higher else ">"
            reasons.append(f"{measure.reason} ({name} {value:.2f} {sign} {limit:.2f})")
    return Verdict(not reasons, tuple(reasons), tuple(checks))
