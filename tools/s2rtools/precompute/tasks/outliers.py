"""How far an instance lies from the others of its side, by embedding.

The mean distance to the nearest neighbours in the principal components is stored as an array, unit
by unit; the score of the index is that distance over the side's median, so 1 is ordinary. Source:
k-nearest-neighbour outlier detection, Angiulli and Pizzuti, 2002, against a seeded sample so that a
million instances stay feasible.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES
from s2rtools.precompute.work_units import ArraySpec, WorkUnit

KIND = "neighbour_distance"


@dataclass(frozen=True, slots=True)
class OutlierSettings:
    """What an outlier score depends on beside the principal components."""

    neighbours: int = 10
    sample: int = 20_000
    seed: int = 7
    version: int = 1

    def facts(self) -> dict[str, Any]:
        return asdict(self)


SETTINGS = OutlierSettings()
_RESOLUTION = 1e-6
_READ_ROWS = 16_384


def distances(root: Path, unit: WorkUnit, threads: int) -> dict[ArraySpec, NDArray[np.float32]]:
    """Neighbour distances of a unit's instances, for each side that is missing."""
    stage = unit.stage
    sample = sample_rows(stage.valid(root))
    start, stop = stage.span(unit.shard)
    made = {}
    for spec in unit.missing:
        side = next(side for side in SIDES if side == spec.side)
        points = stage.source(root, "pca", side)
        rows = np.asarray(points[start:stop])
        around = _gathered(points, sample)
        places = np.arange(start, stop)
        made[spec] = neighbour_distance(rows, places, around, sample, threads)
    return made


def _gathered(points: Any, rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """Rows (ascending) of a Zarr array, read block by block so that little memory is needed."""
    parts = [np.empty((0, points.shape[1]), dtype=np.float32)]
    for start in range(0, points.shape[0], _READ_ROWS):
        first, last = np.searchsorted(rows, [start, start + _READ_ROWS])
        if first < last:
            parts.append(np.asarray(points[start : start + _READ_ROWS])[rows[first:last] - start])
    return np.concatenate(parts)


def sample_rows(
    valid: NDArray[np.bool_], settings: OutlierSettings = SETTINGS
) -> NDArray[np.int64]:
    """The instances that all are compared with, ascending: the valid ones, or a seeded part."""
    rows = np.flatnonzero(valid)
    if rows.size > settings.sample:
        rng = np.random.default_rng(settings.seed)
        rows = np.sort(rng.choice(rows, settings.sample, replace=False))
    return rows


def neighbour_distance(
    points: NDArray[np.float32],
    places: NDArray[np.int64],
    sample: NDArray[np.float32],
    sample_places: NDArray[np.int64],
    threads: int = 1,
    settings: OutlierSettings = SETTINGS,
) -> NDArray[np.float32]:
    """Mean distance of each of `points` (n, d) to its nearest in `sample` (m, d), shape (n,).

    `places` are the instances that rows stand for: no instance is its own neighbour. NaN for
    points that are not finite and where nothing else is in the sample.
    """
    from sklearn.neighbors import NearestNeighbors
    from threadpoolctl import threadpool_limits

    found = np.full(len(points), np.nan, dtype=np.float32)
    rows = np.flatnonzero(np.isfinite(points).all(axis=1))
    count = min(settings.neighbours + 1, len(sample))
    if not rows.size or count == 0:
        return found
    with threadpool_limits(threads):
        search = NearestNeighbors(n_neighbors=count, algorithm="brute").fit(sample)
        distance, near = search.kneighbors(points[rows])
    length = np.linalg.norm(points[rows], axis=1)
    distance[distance < _RESOLUTION * length[:, None]] = 0.0  # equal embeddings
    others = sample_places[near] != places[rows, None]
    others[others.all(axis=1), settings.neighbours :] = False  # itself was not among them
    total = np.where(others, distance, 0.0).sum(axis=1)
    known = others.sum(axis=1)
    found[rows[known > 0]] = (total[known > 0] / known[known > 0]).astype(np.float32)
    return found


def scores(distance: NDArray[np.float32]) -> NDArray[np.float64]:
    """Distances (n,) over their median; NaN where a distance is, and where the median is 0."""
    values = np.asarray(distance, dtype=np.float64)
    known = values[np.isfinite(values)]
    median = float(np.median(known)) if known.size else 0.0
    if not median > 0:
        return np.full(values.shape, np.nan)
    return values / median
