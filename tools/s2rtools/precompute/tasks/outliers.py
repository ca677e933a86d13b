"""Task: outlier scores, by the distance of an instance's embedding to the others of its side.

The mean distance to the nearest neighbours in the principal components is stored as an array. The
score in the index is that distance over the side's median, so 1 is typical. Source:
k-nearest-neighbour outlier detection, Angiulli and Pizzuti, 2002, against a seeded sample to stay
feasible for a million instances.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import SIDES
from s2rtools.precompute.array_keys import content_key
from s2rtools.precompute.tasks.umap_projection import sample_rows
from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

KIND = "neighbour_distance"
NAME = "outlier"
"""Name of the stages of these distances."""


@dataclass(frozen=True, slots=True)
class OutlierSettings:
    """Parameters of an outlier score."""

    neighbours: int = 10
    sample: int = 20_000
    seed: int = 7
    version: int = 1


SETTINGS = OutlierSettings()
OUTLIER_ROWS = 32_768
_RESOLUTION = 1e-6


def outlier_stage(fit: Stage, projection: Stage) -> Stage:
    """The stage that computes distances of instances of a projection to their nearest neighbours.

    Neighbours are instances of the same side that the projection `fit` was fitted on; distances
    are those of principal components.
    """
    components = projection.specs_of_kind("pca")
    key = content_key({"pca": components[0].key, **asdict(SETTINGS)})
    specs = tuple(
        ArraySpec(KIND, side, None, (), "float32", ("iid",), "", key, projection.rows,
                  first_iid=projection.first_iid)
        for side in SIDES
    )  # fmt: skip
    predictions = (spec for spec in projection.sources if spec.kind == "prediction")
    sources = tuple(dict.fromkeys((*predictions, *fit.specs_of_kind("pca"), *components)))
    return Stage(
        NAME, projection.run, specs, OUTLIER_ROWS, sources, projection.fitted,
        compute=compute_distances,
    )  # fmt: skip


def compute_distances(
    computer: UnitComputer, unit: WorkUnit
) -> dict[ArraySpec, NDArray[np.float32]]:
    """Neighbour distances of a unit's instances, for each missing side."""
    root, stage = computer.root, unit.stage
    valid = stage.valid_instances(root, range(stage.fitted))
    sample = sample_rows(valid, SETTINGS.sample, SETTINGS.seed)
    iids = np.array(unit.instances)
    distances = {}
    for spec in unit.missing:
        points = stage.source_array(root, "pca", spec.side)
        distances[spec] = neighbour_distance(
            points.at(iids), iids, points.at(sample), sample, computer.threads
        )
    return distances


def neighbour_distance(
    points: NDArray[np.float32],
    iids: NDArray[np.int64],
    sample: NDArray[np.float32],
    sample_iids: NDArray[np.int64],
    threads: int = 1,
    settings: OutlierSettings = SETTINGS,
) -> NDArray[np.float32]:
    """Mean distance of each of `points` (n, d) to its nearest in `sample` (m, d), shape (n,).

    `iids` identify the rows, because no instance is its own neighbour. NaN for points that are not
    finite and for points without another instance in the sample.
    """
    from sklearn.neighbors import NearestNeighbors
    from threadpoolctl import threadpool_limits

    mean_distance = np.full(len(points), np.nan, dtype=np.float32)
    rows = np.flatnonzero(np.isfinite(points).all(axis=1))
    count = min(settings.neighbours + 1, len(sample))
    if not rows.size or count == 0:
        return mean_distance
    with threadpool_limits(threads):
        search = NearestNeighbors(n_neighbors=count, algorithm="brute").fit(sample)
        distance, nearest = search.kneighbors(points[rows])
    length = np.linalg.norm(points[rows], axis=1)
    distance[distance < _RESOLUTION * length[:, None]] = 0.0  # equal embeddings
    others = sample_iids[nearest] != iids[rows, None]
    others[others.all(axis=1), settings.neighbours :] = False  # the point itself was not found
    total = np.where(others, distance, 0.0).sum(axis=1)
    neighbour_count = others.sum(axis=1)
    known = neighbour_count > 0
    mean_distance[rows[known]] = (total[known] / neighbour_count[known]).astype(np.float32)
    return mean_distance


def outlier_scores(distance: NDArray[np.float32]) -> NDArray[np.float64]:
    """Distances (n,) over their median; NaN where the distance is NaN or the median is 0."""
    values = np.asarray(distance, dtype=np.float64)
    known = values[np.isfinite(values)]
    median = float(np.median(known)) if known.size else 0.0
    if not median > 0:
        return np.full(values.shape, np.nan)
    return values / median
