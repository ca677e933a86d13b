"""Task: one seeded UMAP over both sides of a run, so that the two panels are comparable.

PCA is fitted first, in batches of both sides, so that memory does not grow with the data set. UMAP
is fitted on at most `fit_instances` seeded instances; the others are transformed. Source: McInnes
et al., "UMAP", 2018.
"""

from __future__ import annotations

import warnings
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit, content_key

_BATCH = 512


@dataclass(frozen=True, slots=True)
class ProjectionSettings:
    """Parameters of a projection."""

    components: int = 50
    neighbours: int = 15
    min_distance: float = 0.1
    seed: int = 7
    version: int = 2
    fit_instances: int = 10_000


SETTINGS = ProjectionSettings()


def projection_stage(store: Store, forward: Stage) -> Stage:
    """PCA and joint UMAP of the forward stage's embeddings, in a single unit."""
    n = len(store.instances)
    embedding = forward.specs_of_kind("embedding")[0]
    key = content_key({"embedding": embedding.key, **asdict(SETTINGS)})
    specs = [
        ArraySpec(kind, side, None, (width,), "float32", ("iid", axis), "", key, n)
        for kind, width, axis in (("pca", SETTINGS.components, "component"), ("umap", 2, "u v"))
        for side in SIDES
    ]
    sources = forward.specs_of_kind("prediction") + forward.specs_of_kind("embedding")
    return Stage("projection", forward.run, tuple(specs), max(n, 1), sources)


def compute_projection(root: Path, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """Principal components and UMAP coordinates of both sides."""
    stage = unit.stage
    valid = stage.valid_instances(root)
    embeddings = tuple(stage.source_array(root, "embedding", side) for side in SIDES)
    sim, real, _ = principal_components((embeddings[0], embeddings[1]), valid)
    computed = {"pca": (sim, real), "umap": joint_umap((sim, real), valid)}
    return {spec: computed[spec.kind][spec.side == "real"] for spec in unit.missing}


def principal_components(
    sides: tuple[Any, Any], valid: NDArray[np.bool_], settings: ProjectionSettings = SETTINGS
) -> tuple[NDArray[np.float32], NDArray[np.float32], float]:
    """PCA over both sides together.

    `sides` are two (N, D) arrays (Zarr or numpy) of embeddings; rows that are not valid become
    NaN. Returns two (N, components) arrays and the share of variance that they explain.
    """
    from sklearn.decomposition import IncrementalPCA

    rows = sample_rows(valid, settings.fit_instances // 2, settings.seed)
    sim, real = (np.full((s.shape[0], settings.components), np.nan, np.float32) for s in sides)
    if rows.size == 0:
        return sim, real, float("nan")
    cuts = np.array_split(rows, max(1, rows.size // _BATCH))
    count = min(settings.components, sides[0].shape[1], 2 * cuts[0].size)
    model = IncrementalPCA(count)
    with np.errstate(invalid="ignore", divide="ignore"):  # no variance at all
        for cut in cuts:
            model.partial_fit(np.concatenate([_gather(side, cut) for side in sides]))
    for side, out in zip(sides, (sim, real), strict=True):
        for start in range(0, side.shape[0], _BATCH):
            block = np.asarray(side[start : start + _BATCH], dtype=np.float32)
            keep = valid[start : start + _BATCH]
            if keep.any():
                part = np.zeros((int(keep.sum()), settings.components), dtype=np.float32)
                part[:, :count] = model.transform(block[keep])
                out[start : start + _BATCH][keep] = part
    return sim, real, float(model.explained_variance_ratio_.sum())


def joint_umap(
    sides: tuple[NDArray[np.float32], NDArray[np.float32]],
    valid: NDArray[np.bool_],
    settings: ProjectionSettings = SETTINGS,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Coordinates of both sides in one plane, two (N, 2) arrays; NaN where not valid."""
    sim, real = (np.full((valid.size, 2), np.nan, dtype=np.float32) for _ in sides)
    rows = sample_rows(valid, settings.fit_instances // 2, settings.seed)
    if rows.size == 0:
        return sim, real
    points = np.concatenate([side[rows] for side in sides])
    if len(points) <= settings.neighbours + 1 or not np.ptp(points, axis=0).any():
        fitted, transform = points[:, :2], lambda others: others[:, :2]
    else:
        fitted, transform = _fit(points, settings)
    sim[rows], real[rows] = np.split(fitted, 2)
    others = np.setdiff1d(np.flatnonzero(valid), rows)
    for start in range(0, others.size, 4096):
        part = others[start : start + 4096]
        sim[part], real[part] = (transform(side[part]) for side in sides)
    return sim, real


def _fit(points: NDArray[np.float32], settings: ProjectionSettings) -> tuple[Any, Any]:
    from s2rtools.common.numba_cache import cached

    with warnings.catch_warnings(action="ignore"):
        with cached():
            import umap
        reducer = umap.UMAP(
            n_neighbors=settings.neighbours,
            min_dist=settings.min_distance,
            random_state=settings.seed,
            n_jobs=1,
        )
        fitted = reducer.fit_transform(points)

    def transform(others: NDArray[np.float32]) -> Any:
        with warnings.catch_warnings(action="ignore"):
            return reducer.transform(others)

    return fitted, transform


def sample_rows(valid: NDArray[np.bool_], limit: int, seed: int) -> NDArray[np.int64]:
    """The valid instances, ascending; a seeded sample of them if there are more than `limit`."""
    rows = np.flatnonzero(valid)
    if rows.size > limit:
        rows = np.sort(np.random.default_rng(seed).choice(rows, limit, replace=False))
    return rows


def _gather(side: Any, rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """Rows of a Zarr or numpy array."""
    picked = side[rows] if isinstance(side, np.ndarray) else side.at(rows)
    return np.asarray(picked, dtype=np.float32)
