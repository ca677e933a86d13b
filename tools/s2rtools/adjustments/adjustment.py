"""What an adjustment is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES, Side

Images = tuple[NDArray[np.uint8], NDArray[Any]]
Apply = Callable[[NDArray[np.uint8], NDArray[Any], NDArray[np.bool_], float], Images]


@dataclass(frozen=True, slots=True)
class Adjustment:
    """A declared change of what a side looks at, with one parameter.

    `lowest` .. `highest` are allowed, `neutral` changes nothing to the bit, `step` is a sensible
    move of a slider. Adjustments that need a renderer act before those of the images, wherever they
    stand in a chain.
    """

    name: str
    lowest: float
    highest: float
    neutral: float
    step: float
    unit: str
    description: str
    sides: tuple[Side, ...] = field(default=SIDES, kw_only=True)
    needs_renderer: ClassVar[bool] = False


@dataclass(frozen=True, slots=True)
class ImageAdjustment(Adjustment):
    """A change of images that are there.

    `apply(rgb, depth, valid, value)` takes a batch, rgb (B, H, W, 3) uint8, raw depth (B, H, W)
    and its validity, and gives new images of the same types; it is never called with `neutral`.
    """

    apply: Apply


@dataclass(frozen=True, slots=True)
class RenderedAdjustment(Adjustment):
    """A change of the camera: `s2rstore.geometry.camera_offset` says what its name means, and the data
    set's renderer takes the frames anew. Values are differences, so neutral is 0.
    """

    needs_renderer: ClassVar[bool] = True
