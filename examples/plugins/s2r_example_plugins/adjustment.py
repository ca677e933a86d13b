"""Adjustment `gamma`: exponent of the colours between 0 and 1."""

from __future__ import annotations

import numpy as np

from s2rtools.adjustments.adjustment import Depth, ImageAdjustment, Images, Mask, Rgb


def apply(rgb: Rgb, depth: Depth, valid: Mask, value: float) -> Images:
    table = np.rint(255 * (np.arange(256) / 255) ** value).astype(np.uint8)
    return table[rgb], depth


GAMMA = ImageAdjustment(
    "gamma", 0.25, 4.0, 1.0, 0.05, "exponent", "colours to this power", apply, image="rgb"
)
