"""An image as a mark of a plot without axes: pixels or values, with values laid over it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from s2rtui.canvas import Pixels, mix, turbo
from s2rtui.canvas.colour import NO_DEPTH, depth_tint
from s2rtui.canvas.raster import resample
from s2rtui.drawing.heat_colours import Ramp, RampName, heat_colours
from s2rtui.drawing.scale import Floats, Interval

Size = tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class ImageValues:
    """Values (h, w) over a whole image at any resolution, NaN where there are none.

    name: the title of these values where they are drawn apart from the image.
    """

    values: Floats
    scale: Interval
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
    upper left corner where it has no title.
    """

    ground: Pixels | ImageValues | None
    overlay: ImageValues | None = None
    missing: str = ""
    label: str = ""

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
        if self.overlay is None:
            return pixels
        over = self.overlay
        values = resample(np.asarray(over.values, dtype=np.float32), *size)
        colours, opacity = heat_colours(values, over.scale, over.is_signed, unsigned_colours)
        return mix(pixels, colours, opacity)
