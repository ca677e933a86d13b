"""What a run shows about its errors, and the error that new images could remove at each pose.

The evidence are instances that are new to the run, and real images that it was trained on. Local
values are kernel regressions over the evidence near a pose (Nadaraya, "On estimating regression",
1964; Watson, "Smooth regression analysis", 1964), shrunk to the mean of all evidence as if
`PRIOR_COUNT` instances with that mean were there.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import NotComputedError, RequestError
from s2rstore.intervals import Interval, estimates
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rstore.records import SPLITS
from s2rtools.data_collection.candidates import CandidatePoses, Codes, Floats, Poses, PoseSimilarity

if TYPE_CHECKING:
    from s2rtools.data_collection.rendered_views import RenderedViews


_HARM_KIND, _HARM_PLANE = "harm", "position"
_HARM_ROWS = 256
Method = Literal["combined", "error", "novelty", "uniform", "random"]
METHODS: dict[Method, str] = {
    "combined": "the part of the real error that the sim error does not explain, times novelty",
    "error": "the real error",
    "novelty": "how far real images lie from others in the embedding",
    "uniform": "equal everywhere: poses spread evenly over the free floor",
    "random": "no score: poses drawn at random",
}
PRIOR_COUNT = 2.0
NOVELTY_RANGE = (0.5, 2.0)
"""Range of the factor that novelty contributes."""
_ROWS = 512
_PARTS = 24
"""Parts of the evidence, of neighbouring instances each, that an interval leaves out in turn."""
MIN_EVIDENCE = 300
"""Fewest instances of an interval of the reducible error."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Errors of the k instances that are new to a run, and the r real images it was trained on.

    `iids`, `rooms`, `trajectories` (codes), `real_error`, `sim_error` (metres) and `novelty` are
    (k,) in recording order, `poses` (k, 3) those of the real images. `novelty` is the outlier score
    of the real image, 1 for the median. `harm` (k,) in metres is None where the store has no
    heatmaps of it. `trained_poses` (r, 3) and `trained_rooms` (r,) belong to training images of the
    real domain.
    """

    iids: NDArray[np.intp]
    poses: Poses
    rooms: Codes
    trajectories: Codes
    real_error: Floats
    sim_error: Floats
    novelty: Floats
    harm: Floats | None
    trained_poses: Poses
    trained_rooms: Codes

    def __len__(self) -> int:
        return len(self.iids)

    def without(self, rows: slice) -> Evidence:
        """The evidence without some instances; the training images stay."""
        kept = {
            field.name: np.delete(column, rows, axis=0)
            for field in fields(self)
            if not field.name.startswith("trained")
            and (column := getattr(self, field.name)) is not None
        }
        return replace(self, **kept)

    def parts(self) -> list[slice]:
        """About `_PARTS` parts of neighbouring instances: pieces or groups of trajectories."""
        n = len(self)
        ends = np.array([0, *(np.flatnonzero(np.diff(self.trajectories)) + 1), n])
        if len(ends) > _PARTS:
            bounds = ends[np.searchsorted(ends, np.linspace(0, n, _PARTS + 1))]
        else:
            counts = np.maximum(np.round(_PARTS * np.diff(ends) / n).astype(int), 1)
            pieces = [
                np.linspace(start, stop, count, endpoint=False)
                for (start, stop), count in zip(pairwise(ends), counts, strict=True)
            ]
            bounds = np.append(np.concatenate(pieces).astype(int), n)
        return [slice(first, last) for first, last in pairwise(np.unique(bounds).tolist())]


def read_evidence(store: Store, run: str) -> Evidence:
    """The evidence of a computed run.

    Instances that the model was trained on, on either side, tell nothing about its errors and are
    left out. Raises RequestError where no instance is new to the run.
    """
    columns, truth = store.run_columns(run), store.instances
    poses = store.poses(store.run(run).real_domain)
    known = np.isfinite(poses).all(axis=1)
    new = run_metrics.population(store, run) & known & np.isfinite(columns.real.error)
    if not new.any():
        raise RequestError(
            f"run {run}: trained on all instances, so no real error is known; "
            "ingest images that are new to it"
        )
    trained = known & (columns.real.split == SPLITS.index("train"))
    rows = store.in_recording_order(new)
    novelty = columns.real.outlier[rows]
    return Evidence(
        iids=rows,
        poses=poses[rows],
        rooms=truth.room[rows],
        trajectories=truth.trajectory[rows],
        real_error=columns.real.error[rows],
        sim_error=columns.sim.error[rows],
        novelty=np.where(np.isfinite(novelty), novelty, 1.0),
        harm=_harm(store, run, rows),
        trained_poses=poses[trained],
        trained_rooms=truth.room[trained],
    )


def _harm(store: Store, run: str, iids: NDArray[np.intp]) -> Floats | None:
    """The sum of the positive harm in each real image (k,), metres; None where it is unknown.

    Only blocks of instances that hold one of the `iids` (k,) are read.
    """
    if not any(record.kind == _HARM_KIND for record in store.array_kinds(run)):
        return None
    parts, ascending = [], np.sort(iids)
    try:
        for start in np.unique(ascending // _HARM_ROWS) * _HARM_ROWS:
            chosen = ascending[(ascending >= start) & (ascending < start + _HARM_ROWS)]
            first, stop = int(chosen[0]), int(chosen[-1]) + 1
            heat = store.heatmaps(run, _HARM_KIND, "real", first, stop, _HARM_PLANE)
            heat = np.maximum(heat[chosen - first], 0.0)
            parts.append(np.nansum(heat, axis=(1, 2), dtype=np.float64))
    except NotComputedError:
        return None
    return np.concatenate(parts)[np.searchsorted(ascending, iids)]


@dataclass(frozen=True, slots=True, eq=False)
class LocalValues:
    """Expected values at each candidate pose, (P, H) each: errors in metres, novelty, harm.

    `support` is the number of instances near the pose, counted by similarity. `harm` is relative to
    its mean, and 1 where harm is unknown.
    """

    real_error: Floats
    sim_error: Floats
    novelty: Floats
    harm: Floats
    support: Floats

    def reducible(self, method: Method) -> Floats:
        """Metres of error (P, H) that a method expects a perfect set of images to remove.

        A model that knows reality as well as simulation still has the sim error: what is left of
        the real error is the part that real images can remove.
        """
        mean = self.real_error.mean()
        if method == "error":
            return self.real_error
        if method == "novelty":
            return mean * self.novelty
        if method == "combined":
            excess = np.maximum(self.real_error - self.sim_error, 0.0)
            return excess * np.sqrt(self.novelty * self.harm)
        return np.full_like(self.real_error, mean)


def local_values(
    candidates: CandidatePoses, evidence: Evidence, similarity: PoseSimilarity,
    views: RenderedViews | None = None,
) -> LocalValues:  # fmt: skip
    """Expected errors, novelty and harm at each candidate pose.

    Rendered views add sim errors, by which the sim and the real error of their surroundings are
    corrected: the latter by the slope of the real over the sim errors (two-phase regression:
    Cochran, "Sampling techniques", 1977, chapter 12).
    """
    harm = np.ones(len(evidence)) if evidence.harm is None else evidence.harm
    relative = harm / harm.mean() if harm.mean() > 0 else np.ones_like(harm)
    columns = np.column_stack(
        [evidence.real_error, evidence.sim_error, np.clip(evidence.novelty, *NOVELTY_RANGE),
         np.clip(relative, *NOVELTY_RANGE)]
    )  # fmt: skip
    means = columns.mean(axis=0)
    values, support = _smoothed(
        candidates, similarity, evidence.poses, evidence.rooms, columns, means
    )
    real, sim, novelty, harmful = np.moveaxis(values, -1, 0)
    if views is not None:
        seen = views.usable
        rooms = candidates.rooms_of(views.cells[seen])
        dense, _ = _smoothed(
            candidates, similarity,
            np.concatenate([evidence.poses, views.poses[seen]]),
            np.concatenate([evidence.rooms, rooms]),
            np.concatenate([evidence.sim_error, views.sim_errors[seen]])[:, None], means[1:2],
        )  # fmt: skip
        more = dense[..., 0] - sim
        real = np.maximum(real + _slope(evidence) * more, 0.0)
        sim = dense[..., 0]
    return LocalValues(real, sim, novelty, harmful, support)


def reducible_interval(
    candidates: CandidatePoses, evidence: Evidence, similarity: PoseSimilarity, method: Method,
    views: RenderedViews | None = None,
) -> Interval:  # fmt: skip
    """The mean reducible error of a method over all usable candidates, in metres.

    By the jackknife over parts of neighbouring instances. A local excess of real over sim error is
    hidden where few instances tell it; the bounds hold the bias that this causes, by the
    jackknife's estimate, which is too rough of fewer than `MIN_EVIDENCE` instances.
    """

    def mean(known: Evidence) -> float:
        values = local_values(candidates, known, similarity, views)
        return float(values.reducible(method)[candidates.usable].mean())

    value, n = mean(evidence), len(evidence)
    if n < MIN_EVIDENCE:
        return Interval.unknown(value, f"n {n}, a reducible error needs {MIN_EVIDENCE}")
    parts = evidence.parts()
    left_out = np.array([mean(evidence.without(part)) for part in parts])
    sizes = np.array([part.stop - part.start for part in parts])
    influence = (n / sizes - 1) * (value - left_out)
    owners = evidence.trajectories[[part.start for part in parts]]
    found = estimates.linear(value, influence, owners, minimum=_PARTS // 2)
    bias = float(influence.mean())
    low, high = found.low + min(bias, 0.0), found.high + max(bias, 0.0)
    return replace(found, low=low, high=high, sample=None).at_least(0.0)


def _slope(evidence: Evidence) -> float:
    """The slope of the real over the sim errors, 0 to 1."""
    sim = evidence.sim_error - evidence.sim_error.mean()
    square = float(sim @ sim)
    return min(max(float(sim @ evidence.real_error) / square, 0.0), 1.0) if square > 0 else 0.0


def _smoothed(
    candidates: CandidatePoses, similarity: PoseSimilarity, poses: Poses, rooms: Codes,
    columns: Floats, means: Floats,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Local means (P, H, k) of columns (n, k) at poses (n, 3), shrunk to `means` (k,).

    Also returns the number of rows near each candidate, counted by similarity, (P, H).
    """
    shape = candidates.usable.shape
    totals, support = np.empty((*shape, columns.shape[1])), np.empty(shape)
    turned = similarity.of_headings(candidates.headings, poses[:, 2])
    for start in range(0, shape[0], _ROWS):
        rows = slice(start, start + _ROWS)
        near = similarity.of_places(
            candidates.places[rows], candidates.rooms[rows], poses[:, :2], rooms
        )
        support[rows] = near @ turned.T
        for number, column in enumerate(columns.T):
            totals[rows, :, number] = near @ (turned * column).T
    return (totals + PRIOR_COUNT * means) / (support + PRIOR_COUNT)[..., None], support
