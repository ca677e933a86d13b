"""Distance between two sets of images by the distributions of their small patches.

Sliced Wasserstein distance: the mean over random directions of the one-dimensional Wasserstein
distance. Source: Rabin et al., "Wasserstein barycenter and its application to texture mixing",
2011; of patches at several scales: Karras et al., "Progressive growing of GANs for improved
quality, stability, and variation", 2018.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtools.translation.image_set import Rgb, resize

PATCH = 5
PATCHES = 4096
DIRECTIONS = 128
SCALES = (1, 2, 4)


def patch_distance(first: Rgb, second: Rgb, seed: int = 0) -> float:
    """Mean distance in grey levels over three scales; equal sets have about 0.

    The same places are taken from sets of the same shape, so that two translations of the same
    images are compared with little noise.
    """
    distances = []
    for scale in SCALES:
        both = [_patches(_reduced(images, scale), seed) for images in (first, second)]
        width = min(len(values) for values in both)
        rng = np.random.default_rng([seed, scale])
        directions = rng.standard_normal((both[0].shape[1], DIRECTIONS)).astype(np.float32)
        directions /= np.linalg.norm(directions, axis=0)
        first_sorted, second_sorted = (
            np.sort(values[:width] @ directions, axis=0) for values in both
        )
        distances.append(float(np.abs(first_sorted - second_sorted).mean()))
    return float(np.mean(distances))


def _reduced(images: Rgb, scale: int) -> Rgb:
    height, width = images.shape[1:3]
    return resize(images, (max(PATCH, height // scale), max(PATCH, width // scale)))


def _patches(images: Rgb, seed: int) -> NDArray[np.float32]:
    """Random patches (`PATCHES`, 75) of images."""
    rng = np.random.default_rng(seed)
    count, height, width = images.shape[:3]
    rows = rng.integers(count, size=PATCHES)
    tops = rng.integers(height - PATCH + 1, size=PATCHES)
    lefts = rng.integers(width - PATCH + 1, size=PATCHES)
    steps = np.arange(PATCH)
    patches = images[
        rows[:, None, None], tops[:, None, None] + steps[:, None], lefts[:, None, None] + steps
    ]
    return patches.reshape(PATCHES, -1).astype(np.float32)
