"""An image as a mark of a plot without axes: pixels or values, with values laid over it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtui.canvas import Pixels, mix, turbo
from s2rtui.canvas.colour import NO_DEPTH, depth_tint
from s2rtui.canvas.raster import resample
from s2rtui.drawing.heat_colours import Ramp, RampName, heat_colours
from s2rtui.drawing.scale import Floats, Range

Size = tuple[int, int]
Area = tuple[float, float, float, float]
Bools = NDArray[np.bool_]
OUTLINE = (255, 222, 60)
"""The colour of the outline of marked pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageValues:
    """Values (h, w) over a whole image at any resolution, NaN where there are none.

    name: the title of these values where they are drawn apart from the image.
    """

    values: Floats
    scale: Range
    ramp: RampName
    name: str = ""

    @property
    def is_signed(self) -> bool:
        return self.ramp == "signed overlay"


@dataclass(frozen=True, slots=True, eq=False)
class Image:
    """An image that fills its plot.

    ground: pixels (H, W, 3) uint8, or values; None for no image. overlay: values over it, the
    stronger the more opaque. missing: the text in the place of an image. label: a text over its
    upper left corner where it has no title. marked: (h, w), the pixels that are outlined.
    """

    ground: Pixels | ImageValues | None
    overlay: ImageValues | None = None
    missing: str = ""
    label: str = ""
    marked: Bools | None = None

    @classmethod
    def joined(cls, left: Image, right: Image, share: float) -> Image:
        """One image up to a share of the width, and another one beyond; of the size of the left."""
        if left.ground is None or right.ground is None:
            return right if left.ground is None else left
        overlay, marked = left.overlay, left.marked
        if marked is not None and right.marked is not None:
            marked = _joined(marked, right.marked, share)
        if overlay is not None and right.overlay is not None:
            overlay = replace(overlay, values=_joined(overlay.values, right.overlay.values, share))
        if isinstance(left.ground, ImageValues) and isinstance(right.ground, ImageValues):
            values = _joined(left.ground.values, right.ground.values, share)
            ground: Pixels | ImageValues = replace(left.ground, values=values)
        else:
            ground = _joined(left.ground, right.ground, share)
        return replace(left, ground=ground, overlay=overlay, marked=marked)

    def part(self, area: Area) -> Image:
        """The part of the image in an area: shares x0, y0, x1, y1 of its width and height."""
        if self.ground is None or self.shape is None:
            return self
        x0, y0, x1, y1 = area
        size = (max(1, round((y1 - y0) * self.shape[0])), max(1, round((x1 - x0) * self.shape[1])))

        def cut(values: Any) -> Any:
            rows, columns = (
                np.clip(((low + (np.arange(n) + 0.5) / n * (high - low)) * whole), 0, whole - 1)
                for low, high, n, whole in zip((y0, x0), (y1, x1), size, values.shape, strict=False)
            )
            return values[rows.astype(np.intp)[:, None], columns.astype(np.intp)]

        def of(source: Any) -> Any:
            if isinstance(source, ImageValues):
                return replace(source, values=cut(source.values))
            return cut(source)

        overlay = None if self.overlay is None else of(self.overlay)
        marked = None if self.marked is None else cut(self.marked)
        return replace(self, ground=of(self.ground), overlay=overlay, marked=marked)

    @property
    def shape(self) -> Size | None:
        """Rows and columns of the ground."""
        if self.ground is None:
            return None
        source = self.ground.values if isinstance(self.ground, ImageValues) else self.ground
        return source.shape[0], source.shape[1]

    def pixels(
        self, size: Size, shades: int | None = None, unsigned_colours: Ramp = turbo
    ) -> Pixels:
        """The image in `size` (height, width): means of pixels, or the nearest where it is larger.

        shades: the number of greys of depth, see `depth_tint`. Raises ValueError without a ground.
        """
        if self.ground is None:
            raise ValueError("an image without a ground has no pixels")
        if isinstance(self.ground, ImageValues):
            values = resample(self.ground.values, *size)
            low, high = self.ground.scale
            pixels = depth_tint((values - low) / (high - low), shades)
            pixels[~np.isfinite(values)] = NO_DEPTH
        elif self.ground.shape[:2] == size:
            pixels = self.ground
        else:
            pixels = np.rint(resample(self.ground, *size)).astype(np.uint8)
        if self.overlay is not None:
            over = self.overlay
            values = resample(np.asarray(over.values, dtype=np.float32), *size)
            colours, opacity = heat_colours(values, over.scale, over.is_signed, unsigned_colours)
            pixels = mix(pixels, colours, opacity)
        return pixels if self.marked is None else _outlined(pixels, self.marked)


def _joined(left: Any, right: Any, share: float) -> Any:
    """The columns of `left` up to a share of its width, then those of `right` in its size."""
    rows, columns = (
        (np.arange(size) * other // size)
        for size, other in zip(left.shape[:2], right.shape[:2], strict=True)
    )
    split = round(share * left.shape[1])
    return np.concatenate([left[:, :split], right[rows[:, None], columns[split:]]], axis=1)


def _outlined(pixels: Pixels, marked: Bools) -> Pixels:
    """Pixels (H, W, 3) with the outer ones of those that are marked in the outline's colour."""
    inside = resample(marked.astype(np.float32), *pixels.shape[:2]) >= 0.5
    padded = np.pad(inside, 1)
    neighbours = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    shown = pixels.copy()
    shown[inside & ~neighbours] = OUTLINE
    return shown
