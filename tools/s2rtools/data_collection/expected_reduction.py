"""The error that new images could remove at each candidate pose.

Local values are kernel regressions over the evidence near a pose (Nadaraya, "On estimating
regression", 1964; Watson, "Smooth regression analysis", 1964), shrunk to the mean of all evidence
as if `PRIOR_COUNT` instances with that mean were there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from s2rtools.data_collection.candidates import CandidatePoses
from s2rtools.data_collection.evidence import Evidence
from s2rtools.data_collection.pose_similarity import Floats, PoseSimilarity

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
    candidates: CandidatePoses, evidence: Evidence, similarity: PoseSimilarity
) -> LocalValues:
    """Expected errors, novelty and harm at each candidate pose."""
    harm = np.ones(len(evidence)) if evidence.harm is None else evidence.harm
    relative = harm / harm.mean() if harm.mean() > 0 else np.ones_like(harm)
    columns = np.column_stack(
        [evidence.real_error, evidence.sim_error, np.clip(evidence.novelty, *NOVELTY_RANGE),
         np.clip(relative, *NOVELTY_RANGE)]
    )  # fmt: skip
    means = columns.mean(axis=0)
    shape = candidates.usable.shape
    totals = np.empty((*shape, columns.shape[1]))
    support = np.empty(shape)
    turned = similarity.of_headings(candidates.headings, evidence.poses[:, 2])
    for start in range(0, shape[0], _ROWS):
        rows = slice(start, start + _ROWS)
        near = similarity.of_places(
            candidates.places[rows], candidates.rooms[rows], evidence.poses[:, :2], evidence.rooms
        )
        support[rows] = near @ turned.T
        for number, column in enumerate(columns.T):
            totals[rows, :, number] = near @ (turned * column).T
    values = (totals + PRIOR_COUNT * means) / (support + PRIOR_COUNT)[..., None]
    real, sim, novelty, harmful = np.moveaxis(values, -1, 0)
    return LocalValues(real, sim, novelty, harmful, support)
