"""Which images a translator is fitted on, and which are held out to judge it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SPLITS

FITTED, HELD_OUT, UNSEEN = (SPLITS.index(name) for name in ("train", "test", "unseen"))
BLOCK, SHORT_BLOCK = 16, 8
"""Images of a block, and of one in a recording of fewer than three blocks."""
HELD_OUT_EVERY = 3
BORDER = 2
"""Images between a held-out block and the images of the fit; used for neither."""
RULE = (
    f"contiguous blocks of {BLOCK} images in each recording ({SHORT_BLOCK} in recordings of fewer "
    f"than {HELD_OUT_EVERY * BLOCK}); every {HELD_OUT_EVERY}rd block is held out; the {BORDER} "
    "images on each side of it are left out"
)


def split_codes(groups: NDArray[np.integer[Any]]) -> NDArray[np.int8]:
    """Assign images in recording order to the fit or to judging; `groups` (N,) are recordings.

    Returns codes (N,) into `records.SPLITS`: train for the fit, test for judging, unseen for
    neither. Blocks are contiguous, and the images beside a held-out block are left out, because
    neighbouring images look alike. At least one block of each recording of two blocks is held out;
    a shorter recording is used for the fit.
    """
    codes = np.full(len(groups), FITTED, dtype=np.int8)
    for group in np.unique(groups):
        rows = np.flatnonzero(groups == group)
        size = BLOCK if len(rows) >= HELD_OUT_EVERY * BLOCK else SHORT_BLOCK
        block = np.arange(len(rows)) // size
        if block[-1] == 0:
            continue
        held_out = block % HELD_OUT_EVERY == min(HELD_OUT_EVERY - 1, block[-1])
        near = np.convolve(held_out, np.ones(2 * BORDER + 1), "same") > 0.5
        codes[rows] = np.select([held_out, near], [HELD_OUT, UNSEEN], FITTED)
    return codes
