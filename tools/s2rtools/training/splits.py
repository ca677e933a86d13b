"""Splits of instances into training, validation and test: int8 codes into `records.SPLITS`.

The split depends on the data only, not on the training seed, so that recipes are compared on the
same held-out instances. Blocks are contiguous because neighbouring frames look alike; if a robot
passes a place twice, a held-out place may still occur in training frames.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SPLITS

TRAIN, VALIDATION, TEST, UNSEEN = (SPLITS.index(name) for name in SPLITS)

NO_SPLIT = -1
"""Code of an instance that the domain has no image of."""
BLOCK = 8
TEST_EVERY = 5
VALIDATION_SHARE = 10
SEED = 20

SIM_RULE = (
    f"sim images: contiguous blocks of {BLOCK} instances in each trajectory: every {TEST_EVERY}th "
    f"is test, one of {VALIDATION_SHARE} of the others (seed {SEED}) validation, the rest train"
)
REAL_RULE = (
    "real images: the first trajectory is test, the others train; the second half is test where "
    f"there is only one; one block of {BLOCK} in {VALIDATION_SHARE} (seed {SEED}) validation"
)

Codes = NDArray[np.int8]


def split_by_blocks(trajectory: NDArray[np.int32]) -> Codes:
    """Split all trajectories into training, validation and test blocks."""
    codes = np.full(len(trajectory), TRAIN, dtype=np.int8)
    for rows in _trajectories(trajectory):
        block = np.arange(len(rows)) // BLOCK
        held_out = block % TEST_EVERY == TEST_EVERY - 1
        codes[rows[held_out]] = TEST
        codes[rows[~held_out & _validation(block[~held_out], block)]] = VALIDATION
    return codes


def split_by_recording(trajectory: NDArray[np.int32]) -> Codes:
    """Train on one part of a recording and test on another; by `REAL_RULE`."""
    codes = np.full(len(trajectory), TEST, dtype=np.int8)
    parts = _trajectories(trajectory)
    training = parts[1:] if len(parts) > 1 else [parts[0][: len(parts[0]) // 2]]
    for rows in training:
        block = np.arange(len(rows)) // BLOCK
        codes[rows] = np.where(_validation(block, block), VALIDATION, TRAIN)
    return codes


def with_earlier(codes: Codes, before: Codes | None) -> Codes:
    """A split in which no test instance is one that an earlier training or validation used."""
    if before is None:
        return codes
    seen = (before == TRAIN) | ((before == VALIDATION) & (codes == TEST))
    return np.where(seen, before, codes)


def _trajectories(trajectory: NDArray[np.int32]) -> list[NDArray[np.intp]]:
    codes, first = np.unique(trajectory, return_index=True)
    return [np.flatnonzero(trajectory == code) for code in codes[np.argsort(first)]]


def _validation(candidates: NDArray[np.intp], block: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Mark one in ten of the candidate blocks, at least one if there are two or more."""
    blocks = np.unique(candidates)
    if len(blocks) < 2:
        return np.zeros(len(block), dtype=bool)
    count = max(1, round(len(blocks) / VALIDATION_SHARE))
    chosen = np.random.default_rng(SEED).choice(blocks, count, replace=False)
    return np.isin(block, chosen)
