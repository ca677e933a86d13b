"""Shares of the gap: how many metres of e(real) - e(sim) each factor causes."""

from __future__ import annotations

from math import comb

import numpy as np
from numpy.typing import NDArray

from s2rtools.counterfactual.attribution import pose_errors
from s2rtools.counterfactual.factor_composites import FACTORS
from s2rtools.inference import Backend

KIND = "gap_shares"
"""Name of the arrays (iid, factor) of shares, in metres."""
VERSION = 1
"""Changes whenever the values change."""


def gap_shares(
    backend: Backend, composites: NDArray[np.float32], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Shapley value (5,) of each of `FACTORS` for the gap of a pair, in metres.

    `composites` (32, C, h, w) are the inputs of all coalitions, see `composite_inputs`. The shares
    sum to the error of the real image minus that of the sim image.
    """
    errors = pose_errors(backend.forward_all(composites).pose, truth)[:, 0]
    shares = shapley_values(errors)
    assert len(shares) == len(FACTORS)
    return shares


def shapley_values(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Exact Shapley values (players, ...) of the coalition values (2 ** players, ...).

    The index of a coalition has the bit 1 << i set where player i belongs to it. They sum to the
    value of all players minus that of none. Source: Shapley, "A value for n-person games", 1953.
    """
    count = int(np.log2(len(values)))
    if 1 << count != len(values):
        raise ValueError(f"{len(values)} coalitions: not a power of 2")
    index = np.arange(len(values))
    size = np.array([int(k).bit_count() for k in index])
    weight = np.array([1.0 / (count * comb(count - 1, s)) for s in range(count)])
    shares = []
    for player in range(count):
        without = index[(index >> player) & 1 == 0]
        difference = values[without | (1 << player)] - values[without]
        shares.append(np.tensordot(weight[size[without]], difference, axes=1))
    return np.stack(shares)
