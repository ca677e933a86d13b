"""Numerical kernels that fit the light of an image (h, w, 3) by a grid of gains."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.numba_cache import njit


@njit(cache=True, error_model="numpy")
def largest_difference(
    image: NDArray[np.float32], other: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Largest absolute difference of the channels, (h, w)."""
    height, width, _ = image.shape
    found = np.empty((height, width), dtype=np.float32)
    for i in range(height):
        for j in range(width):
            red = abs(image[i, j, 0] - other[i, j, 0])
            green = abs(image[i, j, 1] - other[i, j, 1])
            blue = abs(image[i, j, 2] - other[i, j, 2])
            found[i, j] = max(red, green, blue)
    return found


@njit(cache=True, error_model="numpy")
def robust_weights(
    weight: NDArray[np.float32], residual: NDArray[np.float32], limit: np.float32
) -> NDArray[np.float32]:
    """weight / (1 + (residual / limit)^4), all (h, w)."""
    height, width = weight.shape
    found = np.empty((height, width), dtype=np.float32)
    one = np.float32(1)
    for i in range(height):
        for j in range(width):
            square = residual[i, j] / limit
            square *= square
            found[i, j] = weight[i, j] * (one / (one + square * square))
    return found


@njit(cache=True, error_model="numpy")
def weighted_moments(
    source: NDArray[np.float32], target: NDArray[np.float32], weights: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Weighted means of s, t, s * s and s * t per channel of source and target, (4, 3)."""
    height, width, _ = source.shape
    moments = np.zeros((4, 3))
    total = 0.0
    for i in range(height):
        for j in range(width):
            total += weights[i, j]
    for c in range(3):
        s, t, ss, st = 0.0, 0.0, 0.0, 0.0
        for i in range(height):
            for j in range(width):
                w = np.float64(weights[i, j])
                a, b = np.float64(source[i, j, c]), np.float64(target[i, j, c])
                s += w * a
                t += w * b
                ss += w * a * a
                st += w * a * b
        moments[0, c], moments[1, c], moments[2, c], moments[3, c] = s, t, ss, st
    return moments / max(total, 1e-6)


@njit(cache=True, error_model="numpy")
def cell_sums(
    cell: NDArray[np.int32],
    weights: NDArray[np.float32],
    lit: NDArray[np.float32],
    target: NDArray[np.float32],
    grid: tuple[int, int, int],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sums of weights * lit * target and of weights * lit^2 over each cell, both (*grid, 3).

    `cell` (h, w) is the number of each pixel's cell.
    """
    size = grid[0] * grid[1] * grid[2]
    products, squares = np.zeros((size, 3)), np.zeros((size, 3))
    height, width = cell.shape
    for i in range(height):
        for j in range(width):
            w, number = weights[i, j], cell[i, j]
            for c in range(3):
                level = lit[i, j, c]
                products[number, c] += w * (level * target[i, j, c])
                squares[number, c] += w * (level * level)
    shape = (grid[0], grid[1], grid[2], 3)
    return products.reshape(shape), squares.reshape(shape)


def smoothed(grid: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights 1 2 1 along each of the first three axes of a grid (n, rows, cols, 3).

    Not compiled: compiling takes 4 s, and the grid is small.
    """
    for axis in range(3):
        last = grid.shape[axis] - 1
        at = np.arange(last + 1)
        before = np.take(grid, np.maximum(at - 1, 0), axis)
        after = np.take(grid, np.minimum(at + 1, last), axis)
        grid = (before + 2 * grid + after) / 4
    return grid


@njit(cache=True, error_model="numpy")
def sliced(grid: NDArray[np.float32], level: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values (h, w, 3) of a grid (n, rows, cols, 3) at the pixels, linear along each axis.

    `level` (h, w), 0 .. n - 1, is the position along the first axis; the cells of the other axes
    divide the image.
    """
    levels, rows, cols, _ = grid.shape
    height, width = level.shape
    found = np.empty((height, width, 3), dtype=np.float32)
    line = np.empty((levels, cols, 3), dtype=np.float32)
    left = np.empty(width, dtype=np.int32)
    to_right = np.empty(width, dtype=np.float32)
    one = np.float32(1)
    for j in range(width):
        at = min(max((j + 0.5) * cols / width - 0.5, 0.0), cols - 1.0)
        left[j] = min(int(at), max(cols - 2, 0))
        to_right[j] = at - left[j]
    for i in range(height):
        at = min(max((i + 0.5) * rows / height - 0.5, 0.0), rows - 1.0)
        above = min(int(at), max(rows - 2, 0))
        below, down = min(above + 1, rows - 1), np.float32(at - above)
        for k in range(levels):
            for j in range(cols):
                for c in range(3):
                    upper, lower = grid[k, above, j, c], grid[k, below, j, c]
                    line[k, j, c] = upper * (one - down) + lower * down
        for j in range(width):
            low = min(int(level[i, j]), levels - 2)
            up, right = level[i, j] - np.float32(low), to_right[j]
            a, b = left[j], min(left[j] + 1, cols - 1)
            for c in range(3):
                near = line[low, a, c] * (one - right) + line[low, b, c] * right
                far = line[low + 1, a, c] * (one - right) + line[low + 1, b, c] * right
                found[i, j, c] = near * (one - up) + far * up
    return found


@njit(cache=True, error_model="numpy")
def lit_image(
    image: NDArray[np.float32], slope: NDArray[np.float32], offset: NDArray[np.float32]
) -> NDArray[np.float32]:
    """slope * image + offset, both (3,) per channel."""
    height, width, _ = image.shape
    found = np.empty_like(image)
    for i in range(height):
        for j in range(width):
            for c in range(3):
                found[i, j, c] = slope[c] * image[i, j, c] + offset[c]
    return found


@njit(cache=True, error_model="numpy")
def unlit_image(
    image: NDArray[np.float32],
    gain: NDArray[np.float32],
    slope: NDArray[np.float32],
    offset: NDArray[np.float32],
) -> NDArray[np.float32]:
    """(image / gain - offset) / slope, within 0 .. 255; slope and offset (3,) per channel."""
    height, width, _ = image.shape
    found = np.empty_like(image)
    darkest, brightest = np.float32(0), np.float32(255)
    for i in range(height):
        for j in range(width):
            for c in range(3):
                level = (image[i, j, c] / gain[i, j, c] - offset[c]) / slope[c]
                found[i, j, c] = min(max(level, darkest), brightest)
    return found
