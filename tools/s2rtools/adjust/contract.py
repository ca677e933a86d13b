"""What an adjustment is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Images = tuple[NDArray[np.uint8], NDArray[Any]]
Apply = Callable[[NDArray[np.uint8], NDArray[Any], NDArray[np.bool_], float], Images]


@dataclass(frozen=True, slots=True)
class Adjustment:
    """A declared change of input images with one parameter.

    `apply(rgb, depth, valid, value)` takes a batch, rgb (B, H, W, 3) uint8, raw depth (B, H, W)
    and its validity, and gives new images of the same types; it is never called with `neutral`.
    """

    name: str
    lowest: float
    highest: float
    neutral: float
    unit: str
    description: str
    apply: Apply
