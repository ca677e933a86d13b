"""Images of coloured rectangles in two palettes: unpaired images with known counterparts."""

import numpy as np
from numpy.typing import NDArray

from s2rtools.translation.image_set import ImageSet, Rgb

SIZE = 32
PALETTES = {
    "first": [(60, 60, 70), (230, 210, 40), (220, 220, 225), (200, 40, 40)],
    "second": [(95, 75, 60), (150, 180, 60), (170, 190, 235), (150, 30, 110)],
}
_NOISE = 4.0


def shapes(seed: int, count: int, size: int = SIZE) -> NDArray[np.intp]:
    """Colour numbers (N, size, size): a background and six rectangles in three colours."""
    rng = np.random.default_rng(seed)
    drawn = np.zeros((count, size, size), dtype=np.intp)
    for image in drawn:
        for colour in (1, 2, 3, 1, 2, 3):
            top, left = rng.integers(0, size - 8, 2)
            height, width = rng.integers(5, 14, 2)
            image[top : top + height, left : left + width] = colour
    return drawn


def painted(colours: NDArray[np.intp], palette: str, seed: int) -> Rgb:
    """Images (N, size, size, 3) with a little noise."""
    clean = np.array(PALETTES[palette])[colours]
    noise = np.random.default_rng(seed).normal(0, _NOISE, clean.shape)
    return np.clip(np.rint(clean + noise), 0, 255).astype(np.uint8)


def image_set(images: Rgb, name: str = "images") -> ImageSet:
    names = tuple(str(row) for row in range(len(images)))
    return ImageSet(name, images, np.zeros(len(images), dtype=np.int32), names)


def unpaired() -> tuple[ImageSet, ImageSet]:
    """Different shapes in both palettes."""
    return (
        image_set(painted(shapes(1, 60), "first", 1)),
        image_set(painted(shapes(2, 60), "second", 2)),
    )


def counterparts(count: int = 16) -> tuple[Rgb, Rgb]:
    """The same unseen shapes in both palettes."""
    unseen = shapes(3, count)
    return painted(unseen, "first", 3), painted(unseen, "second", 4)


def difference(first: Rgb, second: Rgb) -> float:
    """Mean absolute difference in grey levels."""
    return float(np.abs(first.astype(np.float64) - second).mean())
