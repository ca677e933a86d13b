"""Taking the image away: what a network says when it sees nothing."""

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
    "black", 0.0, 1.0, 0.0, 0.05, "share", "so much of RGB and depth taken away", _black
)
