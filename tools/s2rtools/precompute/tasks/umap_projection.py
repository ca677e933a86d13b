"""Task: one seeded UMAP over both sides of a run, so that the two panels are comparable.

PCA is fitted first, in batches of both sides, so that memory does not grow with the data set. UMAP
is fitted on at most `fit_instances` seeded instances; the others are transformed.

Instances that were appended after the fit are transformed, too, so that the points of the others
stay where they are. For that the fit is repeated on the same sample, which gives the same model by
its seed on the same machine. The repeated points are compared with the stored ones: with another
processor or library they may be others, and new points would not fit among them.

Source: McInnes et al., "UMAP", 2018.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays.row_array import RowArray
from s2rstore.errors import RequestError
from s2rstore.records import SIDES
from s2rtools.precompute.array_keys import content_key
from s2rtools.precompute.unit_computer import UnitComputer
from s2rtools.precompute.work_units import ArraySpec, Stage, WorkUnit

if TYPE_CHECKING:
    from sklearn.decomposition import IncrementalPCA

Pair = tuple[NDArray[np.float32], NDArray[np.float32]]
NAME = "projection"
"""Name of the stages of projections."""
Transform = Callable[[NDArray[np.float32]], NDArray[np.float32]]
_BATCH = 512
_TRANSFORMED = 4096
_APPROXIMATED = 4096
"""Points from which UMAP searches for neighbours by pynndescent."""
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


def projection_stage(
    run: str,
    iids: range,
    fitted: int,
    embedding_key: Callable[[range], Any],
    sources: tuple[ArraySpec, ...],
) -> Stage:
    """PCA and joint UMAP of the embeddings of some instances, by the fit on [0, `fitted`).

    These are the fitted instances themselves, as a stage of a single unit, or later ones.
    `embedding_key` gives what identifies the embeddings of some instances; `sources` are the
    predictions and embeddings of all.
    """
    fit = range(fitted)
    facts: dict[str, Any] = {"embedding": embedding_key(fit), **asdict(SETTINGS)}
    specs = _specs(content_key(facts), fit)
    if iids != fit:
        sources += specs
        specs = _specs(content_key({**facts, "transformed": embedding_key(iids)}), iids)
    rows = max(1, len(iids))
    return Stage(NAME, run, specs, rows, sources, fitted, compute=compute_projection)


def _specs(key: str, iids: range) -> tuple[ArraySpec, ...]:
    return tuple(
        ArraySpec(
            kind, side, None, (width,), "float32", ("iid", axis), "", key, len(iids),
            first_iid=iids.start,
        )
        for kind, width, axis in (("pca", SETTINGS.components, "component"), ("umap", 2, "u v"))
        for side in SIDES
    )  # fmt: skip


def compute_projection(computer: UnitComputer, unit: WorkUnit) -> dict[ArraySpec, NDArray[Any]]:
    """Principal components and UMAP coordinates of both sides of the stage's instances.

    Those of instances that were appended after the fit take time that does not grow with the
    others, as the fit is repeated on its sample only.
    """
    root, stage = computer.root, unit.stage
    fitted = stage.valid_instances(root, range(stage.fitted))
    embeddings = [stage.source_array(root, "embedding", side) for side in SIDES]
    if stage.first_iid:
        computed = _project_later(root, stage, (embeddings[0], embeddings[1]), fitted)
    else:
        early = [_Rows(side, slice(0, stage.fitted)) for side in embeddings]
        sim, real, _ = principal_components((early[0], early[1]), fitted, SETTINGS)
        computed = {"pca": (sim, real), "umap": joint_umap((sim, real), fitted, SETTINGS)}
    return {spec: computed[spec.kind][spec.side == "real"] for spec in unit.missing}


def _project_later(
    root: Path, stage: Stage, embeddings: tuple[Any, Any], fitted: NDArray[np.bool_]
) -> dict[str, Pair]:
    """PCA and UMAP of the stage's instances, by the repeated fit on a sample of the `fitted`."""
    later = slice(stage.first_iid, stage.first_iid + stage.rows)
    valid = stage.valid_instances(root, range(later.start, later.stop))
    rows = sample_rows(fitted, SETTINGS.fit_instances // 2, SETTINGS.seed)
    planes = _empty(valid.size, 2), _empty(valid.size, 2)
    if rows.size == 0:
        components = _empty(valid.size, SETTINGS.components)
        return {"pca": (components, components), "umap": planes}
    stored = {
        kind: [np.asarray(stage.source_array(root, kind, side).at(rows)) for side in SIDES]
        for kind in ("pca", "umap")
    }
    model = _fit_components(embeddings, rows, SETTINGS.components)
    for side, expected in zip(embeddings, stored["pca"], strict=True):
        _check_repeated(stage, expected, _components(model, _gather(side, rows), SETTINGS))
    sim, real = (
        _transform_components(model, _Rows(side, later), valid, SETTINGS) for side in embeddings
    )
    points, transform = _fit_points(np.concatenate(stored["pca"]), SETTINGS)
    for repeated, expected in zip(np.split(points, 2), stored["umap"], strict=True):
        _check_repeated(stage, expected, repeated)
    _transform_points(transform, (sim, real), planes, np.flatnonzero(valid))
    return {"pca": (sim, real), "umap": planes}


def _check_repeated(
    stage: Stage, stored: NDArray[np.float32], repeated: NDArray[np.float32]
) -> None:
    """Raise RequestError where `repeated` points (n, d) of a fit differ from the `stored` ones."""
    spread = float(np.ptp(stored)) if stored.size else 0.0
    if not np.allclose(stored, repeated, rtol=0, atol=_REPEATED * spread):
        raise RequestError(
            f"run {stage.run!r}: the projection of the first {stage.fitted} instances cannot be "
            "repeated here, because it was fitted with another processor or library; add --refit "
            "to fit it on all instances again"
        )


class _Rows(RowArray):
    """The rows `span` of an array."""

    def __init__(self, array: RowArray, span: slice) -> None:
        self._array, self._first = array, span.start
        self.shape = (span.stop - span.start, *array.shape[1:])
        self.dtype, self.attrs = array.dtype, array.attrs

    @property
    def path(self) -> Path:
        return self._array.path

    @property
    def block_rows(self) -> int:
        return self._array.block_rows

    def rows(self, start: int, stop: int) -> NDArray[Any]:
        self._check_range(start, stop)
        return self._array.rows(self._first + start, self._first + stop)


def principal_components(
    sides: tuple[Any, Any],
    valid: NDArray[np.bool_],
    settings: ProjectionSettings = SETTINGS,
) -> tuple[NDArray[np.float32], NDArray[np.float32], float]:
    """PCA over both sides together, fitted on a seeded sample of the valid rows.

    `sides` are two (N, D) arrays (Zarr or numpy) of embeddings; rows that are not valid become
    NaN. Returns two (N, components) arrays and the share of variance that they explain.
    """
    rows = sample_rows(valid, settings.fit_instances // 2, settings.seed)
    if rows.size == 0:
        sim, real = (_empty(side.shape[0], settings.components) for side in sides)
        return sim, real, float("nan")
    model = _fit_components(sides, rows, settings.components)
    sim, real = (_transform_components(model, side, valid, settings) for side in sides)
    return sim, real, float(model.explained_variance_ratio_.sum())


def _fit_components(
    sides: Sequence[Any], rows: NDArray[np.int64], components: int
) -> IncrementalPCA:
    from sklearn.decomposition import IncrementalPCA

    cuts = np.array_split(rows, max(1, rows.size // _BATCH))
    model = IncrementalPCA(min(components, sides[0].shape[1], 2 * cuts[0].size))
    with np.errstate(invalid="ignore", divide="ignore"):  # no variance at all
        for cut in cuts:
            model.partial_fit(np.concatenate([_gather(side, cut) for side in sides]))
    return model


def _transform_components(
    model: IncrementalPCA, side: Any, valid: NDArray[np.bool_], settings: ProjectionSettings
) -> NDArray[np.float32]:
    """The components (N, components) of embeddings, in batches; NaN where not valid."""
    out = _empty(side.shape[0], settings.components)
    for start in range(0, side.shape[0], _BATCH):
        keep = valid[start : start + _BATCH]
        if keep.any():
            block = np.asarray(side[start : start + _BATCH], dtype=np.float32)
            out[start : start + _BATCH][keep] = _components(model, block[keep], settings)
    return out


def _components(
    model: IncrementalPCA, embeddings: NDArray[np.float32], settings: ProjectionSettings
) -> NDArray[np.float32]:
    """PCA components of embeddings (n, D); zeros for components that were not fitted."""
    out = np.zeros((len(embeddings), settings.components), dtype=np.float32)
    out[:, : model.n_components_] = model.transform(embeddings)
    return out


def joint_umap(
    sides: Pair, valid: NDArray[np.bool_], settings: ProjectionSettings = SETTINGS
) -> Pair:
    """Coordinates of both sides in one plane, two (N, 2) arrays; NaN where not valid.

    Fitted on a seeded sample of the valid rows.
    """
    sim, real = _empty(valid.size, 2), _empty(valid.size, 2)
    rows = sample_rows(valid, settings.fit_instances // 2, settings.seed)
    if rows.size == 0:
        return sim, real
    embedded, transform = _fit_points(np.concatenate([side[rows] for side in sides]), settings)
    sim[rows], real[rows] = np.split(embedded, 2)
    others = np.setdiff1d(np.flatnonzero(valid), rows)
    _transform_points(transform, sides, (sim, real), others)
    return sim, real


def _transform_points(
    transform: Transform, sides: Pair, planes: Pair, rows: NDArray[np.int64]
) -> None:
    """Set the rows of both planes (N, 2) to the coordinates of those of `sides`, in batches."""
    for start in range(0, rows.size, _TRANSFORMED):
        part = rows[start : start + _TRANSFORMED]
        for side, plane in zip(sides, planes, strict=True):
            plane[part] = transform(side[part])


def _fit_points(
    points: NDArray[np.float32], settings: ProjectionSettings
) -> tuple[NDArray[np.float32], Transform]:
    """UMAP coordinates (n, 2) of points (n, components), and the function that maps others."""
    if len(points) <= settings.neighbours + 1 or not np.ptp(points, axis=0).any():
        return points[:, :2], lambda others: others[:, :2]
    from s2rtools.common.numba_cache import cached, compile_deferred

    with warnings.catch_warnings(action="ignore"):
        with cached():
            import umap
        if len(points) >= _APPROXIMATED:
            compile_deferred()
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


def _empty(rows: int, width: int) -> NDArray[np.float32]:
    """NaN for all values (rows, width)."""
    return np.full((rows, width), np.nan, dtype=np.float32)


def _gather(side: Any, rows: NDArray[np.int64]) -> NDArray[np.float32]:
    """Rows of a Zarr or numpy array."""
    picked = side[rows] if isinstance(side, np.ndarray) else side.at(rows)
    return np.asarray(picked, dtype=np.float32)
