"""Connected regions of a mask, and where they lie in an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_ROWS = ("top", "", "bottom")
_COLUMNS = ("left", "", "right")


def connected_regions(mask: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """The regions of a mask (h, w) whose cells touch by sides or corners, as masks (h, w).

    Each cell takes the smallest number among its neighbours until none changes.
    """
    numbers = np.where(mask, np.arange(1, mask.size + 1).reshape(mask.shape), 0)
    largest = mask.size + 1
    while True:
        padded = np.pad(np.where(mask, numbers, largest), 1, constant_values=largest)
        rows = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
        lowest = np.minimum(np.minimum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
        # Numbers of cells are passed on, so that long regions take few rounds.
        known = np.append(0, np.where(mask, lowest, 0).ravel())
        passed = np.where(mask, known[np.where(mask, lowest, 0)], 0)
        if np.array_equal(passed, numbers):
            break
        numbers = passed
    return [numbers == number for number in np.unique(numbers[mask])]


def place_in_image(region: NDArray[np.bool_]) -> str:
    """Where the centre of a region (h, w) lies, by thirds: `top left`, `right`, `middle`."""
    rows, columns = np.nonzero(region)
    height, width = region.shape
    row = _ROWS[min(2, int(3 * (rows.mean() + 0.5) / height))]
    column = _COLUMNS[min(2, int(3 * (columns.mean() + 0.5) / width))]
    return " ".join(filter(None, (row, column))) or "middle"
