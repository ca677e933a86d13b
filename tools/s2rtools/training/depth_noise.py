"""Depth augmentation after a real sensor: Perlin noise for errors and for missing returns."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

FIELDS = 64
CELLS = (4, 8, 16)
"""Lattice cells along each axis, one per octave; each octave weighs half of the previous one."""

RELATIVE_ERROR = 0.06
"""Standard deviation of the error relative to the depth."""

MISSING = (0.0, 0.25)
"""Share of an image's pixels without a return, stored as depth 0."""


def perlin(shape: tuple[int, int], cells: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """One octave of gradient noise (h, w), zero on the lattice (Perlin 2002, fade 6t^5 - ...)."""
    angle = rng.uniform(0, 2 * np.pi, (cells + 1, cells + 1))
    slope_y, slope_x = np.sin(angle), np.cos(angle)
    y, x = (np.arange(n) / n * cells for n in shape)
    row, column = y.astype(int), x.astype(int)
    v, u = (y - row)[:, None], (x - column)[None, :]

    def corner(down: int, right: int) -> NDArray[np.float64]:
        at = np.ix_(row + down, column + right)
        product: NDArray[np.float64] = slope_y[at] * (v - down) + slope_x[at] * (u - right)
        return product

    fade_v, fade_u = (t * t * t * (t * (t * 6 - 15) + 10) for t in (v, u))
    top = corner(0, 0) * (1 - fade_u) + corner(0, 1) * fade_u
    bottom = corner(1, 0) * (1 - fade_u) + corner(1, 1) * fade_u
    return np.asarray(top * (1 - fade_v) + bottom * fade_v, dtype=np.float32)


def noise_fields(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    """(FIELDS, h, w) sums of octaves, each field with mean 0 and deviation 1."""
    fields = np.zeros((FIELDS, *shape), dtype=np.float32)
    for field in fields:
        for octave, cells in enumerate(CELLS):
            field += perlin(shape, cells, rng) / 2**octave
    fields -= fields.mean(axis=(1, 2), keepdims=True)
    fields /= fields.std(axis=(1, 2), keepdims=True)
    return fields


class DepthNoise:
    """Adds smooth errors that grow with distance, and holes, to the depth of a batch."""

    def __init__(self, shape: tuple[int, int], seed: int) -> None:
        self._fields = torch.from_numpy(noise_fields(shape, np.random.default_rng(seed)))
        self._sorted = self._fields.flatten(1).sort(dim=1).values

    def __call__(self, x: Tensor, generator: torch.Generator) -> Tensor:
        """x (B, 4, h, w) in [-1, 1]; RGB is unchanged."""
        size = len(x)
        error = self._fields[torch.randint(FIELDS, (size,), generator=generator)]
        hole = torch.randint(FIELDS, (size,), generator=generator)
        low, high = MISSING
        share = torch.rand(size, generator=generator) * (high - low) + low
        rank = (share * (self._sorted.shape[1] - 1)).long()
        level = self._sorted[hole, rank]
        distance = (x[:, 3] + 1) * (1 + RELATIVE_ERROR * error)
        distance = torch.where(self._fields[hole] < level[:, None, None], 0.0, distance)
        return torch.cat([x[:, :3], (distance.clamp(0, 2) - 1)[:, None]], dim=1)
