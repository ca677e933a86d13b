"""Which instances a translator is fitted on, and which are held out to judge it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

BLOCK = 8
HELD_OUT_EVERY = 3
RULE = (
    f"contiguous blocks of {BLOCK} images in each recording; every {HELD_OUT_EVERY}rd block is "
    "held out"
)


def held_out(groups: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Mark the held-out rows of images in recording order; `groups` (N,) are recordings.

    Blocks are contiguous because neighbouring images look alike. At least one block of each
    recording of two blocks is held out; a shorter one is used for the fit.
    """
    mask = np.zeros(len(groups), dtype=bool)
    for group in np.unique(groups):
        rows = np.flatnonzero(groups == group)
        block = np.arange(len(rows)) // BLOCK
        mask[rows] = block % HELD_OUT_EVERY == min(HELD_OUT_EVERY - 1, block[-1])
        if block[-1] == 0:
            mask[rows] = False
    return mask
