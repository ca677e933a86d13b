"""Further metrics of the visual axis, each with its noise floor at the same n.

The instances are split into two random halves of whole blocks. A metric compares the sim images of
one half with the real images of the other; its noise floor compares the real images of both. Both
are means over seeded splits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, astuple
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.blocks import Blocks
from s2rtools.common.wasserstein import sliced_wasserstein, wasserstein_by_dimension
from s2rtools.gap.instance_selection import random_halves
from s2rtools.gap.visual.divergence import NEIGHBOURS, PairedSamples, divergences
from s2rtools.gap.visual.feature_distances import (
    frechet_distance,
    kernel_distance,
    prdc,
)

Floats = NDArray[np.float64]
Splits = list[tuple[NDArray[np.int64], NDArray[np.int64]]]

SPLITS = 8


def split_half_metrics(
    sim: Floats, real: Floats, blocks: Blocks, seed: int, samples: Mapping[str, PairedSamples]
) -> dict[str, Any]:
    """Metrics by name: value, noise floor, and the range of the floor over the splits.

    `samples` serve for divergences, features (n, d) for all other metrics.
    `wasserstein_by_dimension` lists value and floor of every dimension.
    """
    splits = random_halves(blocks, SPLITS, seed)
    distances, distance_floors = (
        np.array([wasserstein_by_dimension(side[b], real[a]) for a, b in splits])
        for side in (sim, real)
    )
    measured = [_feature_metrics(sim[b], real[a]) for a, b in splits]
    floors = [_feature_metrics(real[b], real[a]) for a, b in splits]
    metrics = {
        name: _with_floor(*(np.array([row[name] for row in rows]) for rows in (measured, floors)))
        for name in measured[0]
    }
    metrics["wasserstein"] = _with_floor(distances.mean(axis=1), distance_floors.mean(axis=1))
    for name, each in samples.items():
        metrics |= _divergence_metrics(name, each, splits)
    by_dimension = {
        "dimension": list(range(sim.shape[1])),
        "value": distances.mean(axis=0).tolist(),
        "floor": distance_floors.mean(axis=0).tolist(),
    }
    sizes = {"n": int(splits[0][0].size), "splits": SPLITS}
    return {**sizes, **metrics, "wasserstein_by_dimension": by_dimension}


def _feature_metrics(sim: Floats, real: Floats) -> dict[str, float]:
    """The registry of metrics of features (n, d) and (m, d), by name."""
    return {
        "fid": frechet_distance(sim, real),
        "kid": kernel_distance(sim, real),
        **asdict(prdc(real, sim)),
        "sliced_wasserstein": sliced_wasserstein(sim, real),
    }


def _divergence_metrics(
    name: str, points: PairedSamples, splits: Splits
) -> dict[str, dict[str, float | None]]:
    """Divergences in both directions, from rows with values on both sides; none for few rows."""
    known = np.isfinite(np.concatenate([points.sim, points.real], axis=1)).all(axis=1)
    chosen = [(a[known[a]], b[known[b]]) for a, b in splits]
    size = min(half.size for pair in chosen for half in pair)
    if size <= NEIGHBOURS:
        return {}
    measured, floors = (
        np.array([
            astuple(divergences(side[b[:size]], points.real[a[:size]], periods=points.periods))
            for a, b in chosen
        ])
        for side in (points.sim, points.real)
    )  # fmt: skip
    names = f"kl_{name}_sim_real", f"kl_{name}_real_sim"
    return {key: _with_floor(measured[:, k], floors[:, k]) for k, key in enumerate(names)}


def _with_floor(values: Floats, floor: Floats) -> dict[str, float | None]:
    """Figures as JSON data, which has no infinity."""
    figures = {
        "value": values.mean(),
        "floor": floor.mean(),
        "floor_low": floor.min(),
        "floor_high": floor.max(),
    }
    return {name: float(x) if np.isfinite(x) else None for name, x in figures.items()}
