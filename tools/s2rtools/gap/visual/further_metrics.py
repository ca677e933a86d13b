"""Further figures of the visual axis, each beside its real-against-real floor at the same n.

Every figure is of two halves of whole blocks, sim of one against real of the other, and its floor
real of the same two; both are means over seeded splits.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.gap.blocks import Blocks, halves
from s2rtools.gap.visual.fid import frechet_distance
from s2rtools.gap.visual.kid import kernel_distance
from s2rtools.gap.visual.kl_divergence import NEIGHBOURS, BiasWarning, divergences
from s2rtools.gap.visual.low_dimensional_samples import Points
from s2rtools.gap.visual.prdc import support
from s2rtools.gap.visual.wasserstein import sliced_wasserstein, wasserstein_by_dimension

Floats = NDArray[np.float64]
Splits = list[tuple[NDArray[np.int64], NDArray[np.int64]]]

SPLITS = 8


def figures(
    sim: Floats, real: Floats, blocks: Blocks, seed: int, points: Mapping[str, Points]
) -> dict[str, Any]:
    """By name: value, floor and, for the floor, its least and largest over the splits.

    Of features (n, d), and the divergences of `points`; `wasserstein_by_dimension` lists value and
    floor of every dimension.
    """
    splits = halves(blocks, SPLITS, seed)
    moved, still = (
        np.array([wasserstein_by_dimension(side[b], real[a]) for a, b in splits])
        for side in (sim, real)
    )
    measured = [_of_features(sim[b], real[a]) for a, b in splits]
    floors = [_of_features(real[b], real[a]) for a, b in splits]
    found = {name: _beside(_column(measured, name), _column(floors, name)) for name in measured[0]}
    found["wasserstein"] = _beside(moved.mean(axis=1), still.mean(axis=1))
    for name, each in points.items():
        found |= _apart(name, each, splits)
    by_dimension = {
        "dimension": list(range(sim.shape[1])),
        "value": moved.mean(axis=0).tolist(),
        "floor": still.mean(axis=0).tolist(),
    }
    sizes = {"n": int(splits[0][0].size), "splits": SPLITS}
    return {**sizes, **found, "wasserstein_by_dimension": by_dimension}


def _of_features(sim: Floats, real: Floats) -> dict[str, float]:
    share = support(real, sim)
    return {
        "fid": frechet_distance(sim, real),
        "kid": kernel_distance(sim, real),
        "precision": share.precision,
        "recall": share.recall,
        "density": share.density,
        "coverage": share.coverage,
        "sliced_wasserstein": sliced_wasserstein(sim, real),
    }


def _apart(name: str, points: Points, splits: Splits) -> dict[str, dict[str, float | None]]:
    """Divergences both ways, of the rows that both sides know; none where these are too few."""
    known = np.isfinite(np.concatenate([points.sim, points.real], axis=1)).all(axis=1)
    chosen = [(a[known[a]], b[known[b]]) for a, b in splits]
    least = min(half.size for pair in chosen for half in pair)
    if least <= NEIGHBOURS:
        return {}
    measured, floors = (
        np.array([_both_ways(side[b[:least]], points.real[a[:least]], points) for a, b in chosen])
        for side in (points.sim, points.real)
    )
    names = f"kl_{name}_sim_real", f"kl_{name}_real_sim"
    return {key: _beside(measured[:, k], floors[:, k]) for k, key in enumerate(names)}


def _both_ways(sim: Floats, real: Floats, points: Points) -> tuple[float, float]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BiasWarning)
        found = divergences(sim, real, periods=points.periods)
    return found.forward, found.backward


def _column(rows: list[dict[str, float]], name: str) -> Floats:
    return np.array([row[name] for row in rows])


def _beside(values: Floats, floor: Floats) -> dict[str, float | None]:
    return {
        "value": _plain(values.mean()),
        "floor": _plain(floor.mean()),
        "floor_low": _plain(floor.min()),
        "floor_high": _plain(floor.max()),
    }


def _plain(value: float) -> float | None:
    """JSON knows no infinity."""
    return float(value) if np.isfinite(value) else None
