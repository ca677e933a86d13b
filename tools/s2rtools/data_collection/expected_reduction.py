"""The error that new images could remove at each candidate pose.

Local values are kernel regressions over the evidence near a pose (Nadaraya, "On estimating
regression", 1964; Watson, "Smooth regression analysis", 1964), shrunk to the mean of all evidence
as if `PRIOR_COUNT` instances with that mean were there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from s2rtools.data_collection.candidates import CandidatePoses
from s2rtools.data_collection.evidence import Evidence
from s2rtools.data_collection.pose_similarity import Codes, Floats, Poses, PoseSimilarity

if TYPE_CHECKING:
    from s2rtools.data_collection.rendered_views import RenderedViews

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
