"""Procedural rooms and the damage that the gates must catch."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Images = NDArray[np.uint8]

HEIGHT, WIDTH = 96, 128
MATRIX = np.array([[0.62, 0.12, 0.05], [0.08, 0.55, 0.1], [0.02, 0.15, 0.7]])
OFFSET = np.array([30.0, 18.0, 8.0])


def rooms(seed: int, count: int = 10) -> Images:
    """Images (count, HEIGHT, WIDTH, 3) of a shaded wall and floor with boxes and a little noise."""
    rng = np.random.default_rng(seed)
    images = []
    for _ in range(count):
        image = np.empty((HEIGHT, WIDTH, 3), dtype=np.float32)
        horizon = int(rng.integers(HEIGHT // 3, 2 * HEIGHT // 3))
        shade = np.linspace(0.85, 1.1, WIDTH)[None, :, None]
        image[:horizon] = rng.uniform(120, 210, 3) * shade
        image[horizon:] = rng.uniform(60, 130, 3) * shade
        for _ in range(9):
            left, top = int(rng.integers(0, WIDTH - 12)), int(rng.integers(0, HEIGHT - 12))
            right, bottom = left + int(rng.integers(8, 40)), top + int(rng.integers(8, 40))
            colour = tuple(float(value) for value in rng.uniform(20, 240, 3))
            cv2.rectangle(image, (left, top), (right, bottom), colour, cv2.FILLED)
        images.append(cv2.GaussianBlur(image, (0, 0), 0.6) + rng.normal(0, 2, image.shape))
    return as_images(np.stack(images))


def as_images(values: NDArray[np.floating]) -> Images:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def recoloured(images: Images) -> Images:
    """A linear map of colours."""
    return as_images(images @ MATRIX.T + OFFSET)


def blurred(images: Images, sigma: float) -> Images:
    return np.stack([cv2.GaussianBlur(image, (0, 0), sigma) for image in images])


def with_object(images: Images, size: int, seed: int = 0, every: int = 1) -> Images:
    """A square of a colour far from its surroundings, pasted into every `every`-th image."""
    rng = np.random.default_rng(seed)
    changed = images.copy()
    for image in changed[::every]:
        top = int(rng.integers(0, image.shape[0] - size + 1))
        left = int(rng.integers(0, image.shape[1] - size + 1))
        patch = image[top : top + size, left : left + size]
        patch[:] = np.where(patch.reshape(-1, 3).mean(axis=0) > 127, 10, 245)
    return changed


def write_folder(folder: Path, images: Images, first: int = 0) -> Path:
    folder.mkdir()
    for number, image in enumerate(images, start=first):
        cv2.imwrite(str(folder / f"{number:03}.png"), image[..., ::-1])
    return folder
