"""Declaration of an adjustment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES, Side

Rgb = NDArray[np.uint8]
Depth = NDArray[Any]
Mask = NDArray[np.bool_]
Images = tuple[Rgb, Depth]
Apply = Callable[[Rgb, Depth, Mask, float], Images]


@dataclass(frozen=True, slots=True)
class Adjustment:
    """A change of one side's images, with one parameter in `lowest` .. `highest`.

    `neutral` leaves every bit unchanged; `step` is the increment of a slider; `image` is what it
    changes. Adjustments that
    need a renderer are applied before image adjustments, regardless of their order in a chain.
    """

    name: str
    lowest: float
    highest: float
    neutral: float
    step: float
    unit: str
    description: str
    sides: tuple[Side, ...] = field(default=SIDES, kw_only=True)
    image: Literal["rgb", "depth", "rgbd"] = field(default="rgbd", kw_only=True)
    needs_renderer: ClassVar[bool] = False

    def changes(self, channels: str) -> bool:
        """Whether it changes the input of a network with `rgb`, `depth` or `rgbd` channels."""
        return "rgbd" in (self.image, channels) or self.image == channels


@dataclass(frozen=True, slots=True)
class ImageAdjustment(Adjustment):
    """A change of existing images.

    `apply(rgb, depth, valid, value)` takes a batch, rgb (B, H, W, 3) uint8, raw depth (B, H, W)
    and its validity, and returns new images of the same types; `value` is never `neutral`. Depth
    may have another size than RGB. A value `in_pixels` is one in pixels of the stored frame. An
    adjustment that `moves_pixels` sets depth that is not valid or not seen to 0.
    """

    apply: Apply
    in_pixels: bool = field(default=False, kw_only=True)
    moves_pixels: bool = field(default=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class TranslatorAdjustment(Adjustment):
    """A change by a fitted translator; the value is its strength, so neutral is 0.

    In a chain the name of a step is `translate:NAME`, and the step has the translator's `sha256`.
    """


@dataclass(frozen=True, slots=True)
class RenderedAdjustment(Adjustment):
    """A change of camera or lights, for which the data set's renderer renders the frames again.

    `s2rstore.geometry.camera_offset` defines its meaning. Values are differences, of which 0 is
    neutral, or factors, of which 1 is.
    """

    needs_renderer: ClassVar[bool] = True
