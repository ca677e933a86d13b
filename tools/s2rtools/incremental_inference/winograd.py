"""3 x 3 convolution of many small images by Winograd's minimal filtering.

An output tile of m x m values takes (m + 2)^2 multiplications per pair of channels instead of
9 m^2. Its transforms only add and scale; they and the products are matrix products here. In float32
the error is 2e-6 (m = 4) to 5e-5 (m = 7) of the deviation of the outputs. Sources: Lavin and Gray,
"Fast algorithms for convolutional neural networks", 2016; the points of interpolation follow
Barabasz et al., "Error analysis and improving the accuracy of Winograd convolution", 2020.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

KERNEL = 3
TILES = (2, 3, 4, 5, 6, 7)
"""Sides of output tiles, in values."""
_POINTS = tuple(Fraction(p) for p in ("0", "1", "-1", "1/2", "-1/2", "2", "-2", "-1/4"))
_ELEMENT = 60.0
"""Multiply-adds that take as long as one transformed element, which is written, permuted and read.

Fitted to measurements on processors.
"""
_WEIGHT = 10.0
"""Multiply-adds that take as long as reading one transformed weight from memory."""
_USUAL_COUNT = 24
"""Images that are convolved together."""
_VALUES_AT_ONCE = 1 << 22
"""Transformed inputs and outputs that are computed together, 16 MB."""


_WEIGHTS_AT_ONCE = 1 << 13
"""Pairs of channels whose weights are transformed together in float64, so that caches hold them."""


class WinogradConvolution:
    """Convolution with a weight (O, C, 3, 3), stride 1 and no padding, on the processor.

    The weights are transformed once per size of tile.
    """

    def __init__(self, weight: Tensor) -> None:
        self._weight = weight
        self._transformed: dict[int, Tensor] = {}

    def tile(self, size: tuple[int, int], tiles: tuple[int, ...] = TILES) -> int | None:
        """Which of `tiles` suits outputs of a size (rows, columns); None if direct costs less.

        It does not depend on the number of images, so that an image has the same result in every
        batch up to the order of float additions.
        """
        outputs, channels = self._weight.shape[:2]
        direct = _USUAL_COUNT * math.prod(size) * KERNEL**2 * outputs * channels
        costs = {tile: _cost(tile, size, outputs, channels) for tile in tiles}
        best = min(costs, key=lambda tile: costs[tile])
        return best if costs[best] < direct else None

    def __call__(self, x: Tensor, tile: int) -> Tensor:
        """x (B, C, h + 2, w + 2), channels last in memory -> (B, O, h, w), so, too."""
        height, width = (side - KERNEL + 1 for side in x.shape[-2:])
        bottom, right = -height % tile, -width % tile
        if bottom or right:
            x = functional.pad(x, (0, right, 0, bottom))
        tiles = (height + bottom) // tile, (width + right) // tile
        outputs, channels = self._weight.shape[:2]
        values = math.prod(tiles) * (tile + KERNEL - 1) ** 2 * (channels + outputs)
        at_once = max(1, _VALUES_AT_ONCE // values)
        whole = x.new_empty(len(x), tiles[0] * tile, tiles[1] * tile, outputs)
        for part, target in zip(x.split(at_once), whole.split(at_once), strict=True):
            self._convolve(part, tile, tiles, target)
        return whole[:, :height, :width].permute(0, 3, 1, 2)

    def _convolve(self, x: Tensor, tile: int, tiles: tuple[int, int], target: Tensor) -> None:
        """x (B, C, H, W) of whole tiles -> `target` (B, H - 2, W - 2, O)."""
        side = tile + KERNEL - 1
        count, channels = x.shape[:2]
        windows = x.permute(0, 2, 3, 1).unfold(1, side, tile).unfold(2, side, tile)
        samples = windows.permute(4, 5, 0, 1, 2, 3).reshape(side, side, -1)
        inputs = _transformed(samples, 0, tile).view(side * side, -1, channels)
        products = torch.bmm(inputs, self._weights(tile)).view(side, side, -1)
        outputs = _transformed(products, 2, tile).view(tile, tile, count, *tiles, -1)
        split = target.view(count, tiles[0], tile, tiles[1], tile, -1)
        split.copy_(outputs.permute(2, 3, 0, 4, 1, 5))

    def _weights(self, tile: int) -> Tensor:
        """The transformed weights (side^2, C, O)."""
        if tile not in self._transformed:
            side = tile + KERNEL - 1
            kernels = torch.from_numpy(transform_matrices(tile)[1])
            flat = self._weight.detach().permute(2, 3, 1, 0).reshape(KERNEL * KERNEL, -1)
            product = torch.kron(kernels, kernels)
            transformed = torch.empty(side * side, flat.shape[1])
            for part, target in zip(
                flat.split(_WEIGHTS_AT_ONCE, 1), transformed.split(_WEIGHTS_AT_ONCE, 1), strict=True
            ):
                target.copy_(product @ part.double())
            outputs, channels = self._weight.shape[:2]
            self._transformed[tile] = transformed.view(side * side, channels, outputs)
        return self._transformed[tile]


@dataclass(frozen=True, slots=True)
class _Polynomial:
    """The product of (x - p) over points, coefficients from the constant on."""

    coefficients: tuple[Fraction, ...]

    @classmethod
    def with_roots(cls, points: list[Fraction]) -> _Polynomial:
        found = [Fraction(1)]
        for point in points:
            shifted = [Fraction(0), *found]
            found = [s - point * c for s, c in zip(shifted, [*found, Fraction(0)], strict=True)]
        return cls(tuple(found))


@cache
def transform_matrices(
    tile: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Matrices of the inputs (n, n), the kernel (n, 3) and the outputs (m, n); n = m + 2.

    In one dimension, m outputs of a kernel g over n inputs d are
    `outputs @ ((kernel @ g) * (inputs @ d))`.
    """
    n = tile + KERNEL - 1
    points = list(_POINTS[: n - 1])
    inputs, kernel, outputs = np.zeros((n, n)), np.zeros((n, KERNEL)), np.zeros((tile, n))
    for row, point in enumerate(points):
        others = [other for other in points if other != point]
        inputs[row, : n - 1] = [float(c) for c in _Polynomial.with_roots(others).coefficients]
        scale = math.prod(point - other for other in others)
        kernel[row] = [float(point**power / scale) for power in range(KERNEL)]
        outputs[:, row] = [float(point**power) for power in range(tile)]
    inputs[n - 1] = [float(c) for c in _Polynomial.with_roots(points).coefficients]
    kernel[n - 1, KERNEL - 1] = outputs[tile - 1, n - 1] = 1
    return inputs, kernel, outputs


@cache
def _tensors(tile: int) -> tuple[Tensor, ...]:
    return tuple(torch.from_numpy(matrix).float() for matrix in transform_matrices(tile))


def _transformed(values: Tensor, which: int, tile: int) -> Tensor:
    """(n, n, N) multiplied along both first axes by one of `transform_matrices`, (k, k, N)."""
    matrix = _tensors(tile)[which]
    rows = (matrix @ values.reshape(len(values), -1)).view(len(matrix), *values.shape[1:])
    return torch.matmul(matrix, rows)


def _cost(tile: int, size: tuple[int, int], outputs: int, channels: int) -> float:
    """Multiply-adds for outputs of a usual batch, moved elements and weights included."""
    side = (tile + KERNEL - 1) ** 2
    products = side * channels * outputs
    transforms = side * (tile + KERNEL - 1) * 2 * (channels + outputs)
    moved = _ELEMENT * (side * (channels + outputs) + tile**2 * outputs)
    tiles = _USUAL_COUNT * math.prod(-(-length // tile) for length in size)
    return tiles * (products + transforms + moved) + _WEIGHT * products
