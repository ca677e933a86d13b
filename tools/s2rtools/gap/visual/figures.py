"""Further figures of the visual axis, each beside its real-against-real floor at the same n.

Every figure is of two halves of whole blocks, sim of one against real of the other, and its floor
real of the same two; both are means over seeded splits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.gap.blocks import Blocks, halves
from s2rtools.gap.visual.divergence import divergences
from s2rtools.gap.visual.frechet import frechet_distance
from s2rtools.gap.visual.kernel import kernel_distance
from s2rtools.gap.visual.manifold import support
from s2rtools.gap.visual.wasserstein import sliced_wasserstein, wasserstein_by_dimension

Floats = NDArray[np.float64]
Figures = Callable[[Floats, Floats], Mapping[str, float]]

SPLITS = 8
COMPONENTS = 3


def figures(sim: Floats, real: Floats, blocks: Blocks, seed: int) -> dict[str, Any]:
    """By name: value, floor and, for the floor, its least and largest over the splits."""
    splits = halves(blocks, SPLITS, seed)
    planes = _principal(np.concatenate([real, sim]), COMPONENTS)
    sources: list[tuple[Figures, Floats, Floats]] = [
        (_of_features, sim, real),
        (_of_components, planes[len(real) :], planes[: len(real)]),
    ]
    found: dict[str, Any] = {}
    for measure, s, r in sources:
        measured = [measure(s[b], r[a]) for a, b in splits]
        floors = [measure(r[b], r[a]) for a, b in splits]
        found |= {name: _beside(name, measured, floors) for name in measured[0]}
    return {"n": int(splits[0][0].size), "splits": SPLITS, **found}


def _of_features(sim: Floats, real: Floats) -> dict[str, float]:
    share = support(real, sim)
    return {
        "fid": frechet_distance(sim, real),
        "kid": kernel_distance(sim, real),
        "sliced_wasserstein": sliced_wasserstein(sim, real),
        "wasserstein": float(wasserstein_by_dimension(sim, real).mean()),
        "precision": share.precision,
        "recall": share.recall,
        "density": share.density,
        "coverage": share.coverage,
    }


def _of_components(sim: Floats, real: Floats) -> dict[str, float]:
    both = divergences(sim, real)
    return {"kl_sim_real": both.forward, "kl_real_sim": both.backward}


def _beside(
    name: str, measured: list[Mapping[str, float]], floors: list[Mapping[str, float]]
) -> dict[str, float | None]:
    values, floor = (np.array([one[name] for one in many]) for many in (measured, floors))
    return {
        "value": _plain(values.mean()),
        "floor": _plain(floor.mean()),
        "floor_low": _plain(floor.min()),
        "floor_high": _plain(floor.max()),
    }


def _plain(value: float) -> float | None:
    """JSON knows no infinity."""
    return float(value) if np.isfinite(value) else None


def _principal(points: Floats, count: int) -> Floats:
    """Coordinates along the directions of most variance, (n, count or less)."""
    centred = points - points.mean(axis=0)
    if len(points) < points.shape[1]:
        values, vectors = np.linalg.eigh(centred @ centred.T)
        return np.asarray(vectors[:, ::-1] * np.sqrt(np.maximum(values[::-1], 0)))[:, :count]
    _, directions = np.linalg.eigh(centred.T @ centred)
    return np.asarray(centred @ directions[:, ::-1][:, :count])
