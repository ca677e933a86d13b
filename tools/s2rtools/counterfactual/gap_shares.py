"""Shares of the gap: how many metres of e(real) - e(sim) each factor causes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.shapley import shapley_values
from s2rtools.counterfactual.attribution import pose_errors
from s2rtools.counterfactual.factor_composites import FACTORS
from s2rtools.inference import Backend

KIND = "gap_shares"
"""Name of the arrays (iid, factor) of shares, in metres."""
VERSION = 3
"""Changes whenever the values change."""


def gap_shares(
    backend: Backend, composites: NDArray[np.float32], truth: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Shapley value (5,) of each of `FACTORS` for the gap of a pair, in metres.

    `composites` (32, C, h, w) are the inputs of all coalitions, see `composite_inputs`. The shares
    sum to the error of the real image minus that of the sim image.
    """
    errors = pose_errors(backend.poses(composites), truth)[:, 0]
    shares = shapley_values(errors)
    assert len(shares) == len(FACTORS)
    return shares
