"""Adjustment that blacks out the images, to test what a network predicts without input."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.adjustments.adjustment import ImageAdjustment, Images


def _black(
    rgb: NDArray[np.uint8], depth: NDArray[Any], valid: NDArray[np.bool_], value: float
) -> Images:
    """Both images times 1 - value; 1 sets them to zero."""
    keep = 1.0 - value
    dark = np.rint(rgb * keep).astype(np.uint8)
    return dark, np.rint(depth * keep).astype(depth.dtype)


BLACK = ImageAdjustment(
    "black", 0.0, 1.0, 0.0, 0.05, "share", "share of RGB and depth removed", _black
)
