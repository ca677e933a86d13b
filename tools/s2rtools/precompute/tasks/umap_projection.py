"""Task: one seeded UMAP over both sides of a run, so that the two panels are comparable.

PCA is fitted first, in batches of both sides, so that memory does not grow with the data set. UMAP
is fitted on at most `fit_instances` seeded instances; the others are transformed.

Instances that were appended after the fit are transformed, too, so that the points of the others
stay where they are. For that the fit is repeated, which gives the same model by its seed on the
same machine. The repeated points are compared with the stored ones: with another processor or
library they may be others, and new points would not fit among them.

Source: McInnes et al., "UMAP", 2018.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays.row_array import RowArray
from s2rstore.errors import RequestError
from s2rstore.records import SIDES
from s2rtools.precompute.array_keys import content_key
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

_BATCH = 512
_REPEATED = 1e-3
"""Differences to a repeated fit that are allowed, as a share of the spread of its points."""


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


def projection_stages(forwards: Sequence[Stage], fitted: int) -> list[Stage]:
    """PCA and joint UMAP of the embeddings of the forward stages of all parts.

    One stage, of a single unit, for the instances [0, `fitted`), which are whole parts, and one for
    each later part.
    """
    early = [forward for forward in forwards if forward.first_iid < fitted]
    keys = [_embedding_key(forward) for forward in early]
    facts: dict[str, Any] = {"embedding": keys[0] if len(keys) == 1 else keys, **asdict(SETTINGS)}
    stages = [_stage(early, content_key(facts), 0, fitted, fitted)]
    for forward in forwards[len(early) :]:
        key = content_key({**facts, "transformed": _embedding_key(forward)})
        stage = _stage([*early, forward], key, forward.first_iid, forward.rows, fitted)
        stages.append(replace(stage, sources=stage.sources + stages[0].specs))
    return stages


def _embedding_key(forward: Stage) -> str:
    return forward.specs_of_kind("embedding")[0].key


def _stage(forwards: Sequence[Stage], key: str, first: int, count: int, fitted: int) -> Stage:
    specs = tuple(
        ArraySpec(
            kind, side, None, (width,), "float32", ("iid", axis), "", key, count, first_iid=first
        )
        for kind, width, axis in (("pca", SETTINGS.components, "component"), ("umap", 2, "u v"))
        for side in SIDES
    )
    sources = tuple(
        spec
        for kind in ("prediction", "embedding")
        for forward in forwards
        for spec in forward.specs_of_kind(kind)
    )
    return Stage("projection", forwards[0].run, specs, max(count, 1), sources, fitted)


def compute_projection(root: Path, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """Principal components and UMAP coordinates of both sides of the stage's instances."""
    stage = unit.stage
    first, fitted = stage.first_iid, stage.fitted
    valid = stage.valid_instances(root, range(fitted))
    embeddings = [stage.source_array(root, "embedding", side) for side in SIDES]
    if first:
        later = range(first, first + stage.rows)
        valid = np.concatenate([valid, stage.valid_instances(root, later)])
        embeddings = [_Joined(side, fitted, later) for side in embeddings]
    sim, real, _ = principal_components((embeddings[0], embeddings[1]), valid, fitted=fitted)
    computed = {"pca": (sim, real), "umap": joint_umap((sim, real), valid, fitted=fitted)}
    if first:
        for kind, sides in computed.items():
            for name, values in zip(SIDES, sides, strict=True):
                stored = stage.source_array(root, kind, name).rows(0, fitted)
                _check_repeated(stage.run, stored, values[:fitted])
    wanted = slice(fitted, None) if first else slice(None)
    return {spec: computed[spec.kind][spec.side == "real"][wanted] for spec in unit.missing}


def _check_repeated(run: str, stored: NDArray[np.float32], repeated: NDArray[np.float32]) -> None:
    """Raise RequestError where `repeated` points (n, d) of a fit differ from the `stored` ones."""
    spread = float(np.ptp(stored[np.isfinite(stored)])) if np.isfinite(stored).any() else 0.0
    if not np.allclose(stored, repeated, rtol=0, atol=_REPEATED * spread, equal_nan=True):
        raise RequestError(
            f"run {run!r}: the projection of the first {len(stored)} instances cannot be repeated "
            "here, because it was fitted with another processor or library; add --refit to fit "
            "it on all instances again"
        )


class _Joined(RowArray):
    """The rows [0, `fitted`) of an array, then its rows `later`."""

    def __init__(self, array: RowArray, fitted: int, later: range) -> None:
        self._array, self._fitted, self._later = array, fitted, later
        self.shape = (fitted + len(later), *array.shape[1:])
        self.dtype, self.attrs = array.dtype, array.attrs

    @property
    def path(self) -> Path:
        return self._array.path

    @property
    def block_rows(self) -> int:
        return self._array.block_rows

    def rows(self, start: int, stop: int) -> NDArray[Any]:
        self._check_range(start, stop)
        shift = self._later.start - self._fitted
        early = self._array.rows(min(start, self._fitted), min(stop, self._fitted))
        low, high = max(start, self._fitted), max(stop, self._fitted)
        return np.concatenate([early, self._array.rows(low + shift, high + shift)])


def principal_components(
    sides: tuple[Any, Any],
    valid: NDArray[np.bool_],
    settings: ProjectionSettings = SETTINGS,
    fitted: int | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32], float]:
    """PCA over both sides together, fitted on the first `fitted` rows (default: all).

    `sides` are two (N, D) arrays (Zarr or numpy) of embeddings; rows that are not valid become
    NaN. Returns two (N, components) arrays and the share of variance that they explain.
    """
    from sklearn.decomposition import IncrementalPCA

    rows = sample_rows(valid[:fitted], settings.fit_instances // 2, settings.seed)
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
    fitted: int | None = None,
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Coordinates of both sides in one plane, two (N, 2) arrays; NaN where not valid.

    Fitted on the first `fitted` rows (default: all).
    """
    sim, real = (np.full((valid.size, 2), np.nan, dtype=np.float32) for _ in sides)
    rows = sample_rows(valid[:fitted], settings.fit_instances // 2, settings.seed)
    if rows.size == 0:
        return sim, real
    points = np.concatenate([side[rows] for side in sides])
    if len(points) <= settings.neighbours + 1 or not np.ptp(points, axis=0).any():
        embedded, transform = points[:, :2], lambda others: others[:, :2]
    else:
        embedded, transform = _fit(points, settings)
    sim[rows], real[rows] = np.split(embedded, 2)
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
