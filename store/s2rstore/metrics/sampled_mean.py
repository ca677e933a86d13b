"""The mean real error over candidate poses, from images at the poses of a stratified sample."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from s2rstore import intervals
from s2rstore.errors import RequestError
from s2rstore.files.planned_poses import PoseSample
from s2rstore.geometry import angles
from s2rstore.intervals import Interval
from s2rstore.metrics.evaluation import applied_to
from s2rstore.reader import Store
from s2rstore.records import TRAINING_SPLITS

Floats = NDArray[np.float64]

MATCH_METRES, MATCH_DEGREES = 0.5, 20.0
"""Largest distance of an image from the pose that it was taken for."""


@dataclass(frozen=True, slots=True, eq=False)
class SampledMean:
    """The mean real error of a run in metres over `candidates`, from a sample of `planned` poses.

    It is that of the localised images, all but `lost`, and has an interval if every pose has a
    localised image. metres, degrees: offsets of the images (n,) from their poses.
    """

    planned: int
    candidates: str
    lost: int
    metres: Floats
    degrees: Floats
    mean: Interval

    @property
    def missing(self) -> int:
        """The number of poses without an image."""
        return self.planned - self.metres.size

    @property
    def text(self) -> str:
        """The mean as a sentence, and how many images at random poses would be as exact."""
        taken, metres, degrees = self.metres.size, self.metres, self.degrees
        of = " of the localised images" if self.lost else ""
        text = (
            f"mean real error{of} over the candidates ({self.candidates}) "
            f"{self.mean.with_bounds('{:.2f}'.format)} m: {taken} images within {MATCH_METRES:g} m "
            f"and {MATCH_DEGREES:g} degrees of {self.planned} sampled poses"
        )
        if taken:
            text += (
                f", {metres.mean():.2f} m and {degrees.mean():.1f} degrees from them in the mean, "
                f"{metres.max():.2f} m and {degrees.max():.1f} degrees at most"
            )
        if self.mean.sample is None:
            return text
        return f"{text}; as exact as about {self.mean.sample.effective_n:.0f} at random poses"

    def as_json(self) -> dict[str, Any]:
        """The mean as JSON data; offsets are null without images."""
        offsets = {
            f"{name}_offset_{unit}": round(float(of(values)), 6) if values.size else None
            for unit, values in (("m", self.metres), ("deg", self.degrees))
            for name, of in (("mean", np.mean), ("largest", np.max))
        }
        return {
            "planned": self.planned, "taken": self.metres.size, "missing": self.missing,
            "not_localised": self.lost, "candidates": self.candidates, **offsets,
            "mean_error_m": self.mean.as_json(),
        }  # fmt: skip


def sampled_mean(store: Store, run: str, sample: PoseSample) -> SampledMean:
    """The mean real error from the images that were taken at the poses of a sample.

    An image counts for the nearest pose, one for each, with or without a sim image, if its instance
    was added after the poses were chosen and the model was not trained on it. Raises RequestError
    where the store has fewer instances than then.
    """
    count, planned = len(store.instances), len(sample.poses)
    if count < sample.instances:
        raise RequestError(
            f"{store.path}: {count} instances, the sample is of a store with {sample.instances}"
        )
    real, truth = store.run_columns(run).real, store.poses(store.run(run).real_domain)
    new = (real.split < 0) | (real.split >= len(TRAINING_SPLITS))
    counts = applied_to(real) & new & np.isfinite(truth).all(axis=1)
    counts[: sample.instances] = False
    images = np.flatnonzero(counts)
    wanted = np.array([(p.x_m, p.y_m, math.radians(p.heading_deg)) for p in sample.poses])
    rows = _nearest(wanted, truth[images])
    wanted, taken = wanted[rows >= 0], images[rows[rows >= 0]]
    offset = truth[taken, :2] - wanted[:, :2]
    turned = np.degrees(angles.distance(truth[taken, 2], wanted[:, 2]))
    errors = real.error[taken].astype(np.float64)
    lost, missing = int(np.count_nonzero(np.isnan(errors))), planned - taken.size
    mean = intervals.stratified_mean(errors[~np.isnan(errors)])
    reasons = [f"{missing} of {planned} poses have no image"] if missing else []
    reasons += [f"{lost} of {taken.size} images are not localised"] if lost else []
    if reasons:
        text = f"{' and '.join(reasons)}; the mean may be biased"
        mean = Interval.unknown(mean.value, text)
    return SampledMean(planned, sample.candidates, lost, np.hypot(*offset.T), turned, mean)


def _nearest(wanted: NDArray[np.float64], taken: NDArray[np.float64]) -> NDArray[np.intp]:
    """The row of `taken` (m, 3) for each pose `wanted` (n, 3), the nearest first; -1 for none."""
    near = KDTree(taken[:, :2]).query_ball_point(wanted[:, :2], MATCH_METRES)
    pairs = [(pose, row) for pose, rows in enumerate(near) for row in rows]
    pose, row = np.array(pairs, dtype=np.intp).reshape(-1, 2).T
    turned = np.degrees(angles.distance(wanted[pose, 2], taken[row, 2]))
    apart = np.hypot(*(wanted[pose, :2] - taken[row, :2]).T) / MATCH_METRES + turned / MATCH_DEGREES
    found = np.full(len(wanted), -1, dtype=np.intp)
    used = np.zeros(len(taken), dtype=np.bool_)
    for number in np.argsort(apart, kind="stable"):
        if turned[number] <= MATCH_DEGREES and found[pose[number]] < 0 and not used[row[number]]:
            found[pose[number]], used[row[number]] = row[number], True
    return found
