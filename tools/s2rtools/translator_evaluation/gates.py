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
from collections.abc import Callable
from dataclasses import dataclass

from s2rtools.translator_evaluation.content_summary import ContentMetrics

SHARPNESS_OF_TARGET = (0.8, 1.0)
"""Range to which the target's sharpness is clipped: a translator may blur as much as its target."""


@dataclass(frozen=True, slots=True)
class Limit:
    """A limit of one metric. `reason` says what failed, `is_minimum` which side is allowed."""

    metric: str
    value: float
    is_minimum: bool
    reason: str

    def passes(self, measured: float, value: float) -> bool:
        """Whether a metric is on the allowed side of `value`."""
        return measured >= value if self.is_minimum else measured <= value


LIMITS = (
    Limit("edge_agreement", 0.7, True, "edges are not those of the source"),
    Limit("luminance_correlation", 0.3, True, "bright and dark do not correspond to the source"),
    Limit("inverted_share", 0.1, False, "bright and dark are inverted"),
    Limit("region_correlation", 0.0, True, "bright and dark regions are inverted"),
    Limit("sharpness", 0.87, True, "images are blurred"),
    Limit("diversity", 0.5, True, "different images become alike"),
    Limit("matched", 0.5, True, "images do not resemble their own source most"),
    Limit("pairing_rank", 0.9, True, "images resemble other sources as much as their own"),
    Limit("invented_share", 0.15, False, "images show structure that the source does not have"),
    Limit("depth_edges_kept", 0.6, True, "outlines at steps of depth are lost"),
)


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


def judge(metrics: ContentMetrics) -> Verdict:
    """Judge the content that a translator keeps. Metrics that are unknown are not judged."""
    checks, reasons = [], []
    for limit in LIMITS:
        measured = float(getattr(metrics, limit.metric))
        if math.isnan(measured):
            continue
        value = _SPECIAL.get(limit.metric, _fixed)(limit, metrics)
        passed = limit.passes(measured, value)
        margin = measured - value if limit.is_minimum else value - measured
        checks.append(Check(limit.metric, measured, value, passed, margin))
        if not passed:
            sign = "<" if limit.is_minimum else ">"
            name = limit.metric.replace("_", " ")
            reasons.append(f"{limit.reason} ({name} {measured:.2f} {sign} {value:.2f})")
    return Verdict(not reasons, tuple(reasons), tuple(checks))


def _fixed(limit: Limit, metrics: ContentMetrics) -> float:
    return limit.value


def _sharpness_limit(limit: Limit, metrics: ContentMetrics) -> float:
    """The limit relative to the target's sharpness where it is less sharp than the source."""
    if math.isnan(metrics.target_sharpness):
        return limit.value
    low, high = SHARPNESS_OF_TARGET
    return limit.value * min(max(metrics.target_sharpness, low), high)


_SPECIAL: dict[str, Callable[[Limit, ContentMetrics], float]] = {"sharpness": _sharpness_limit}
