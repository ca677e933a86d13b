"""The mean real error over the free floor, from images at the poses of a stratified sample."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from s2rstore import intervals
from s2rstore.files.planned_poses import PlannedPose
from s2rstore.geometry import angles
from s2rstore.intervals import Interval
from s2rstore.metrics.evaluation import applied_to
from s2rstore.reader import Store

MATCH_METRES, MATCH_DEGREES = 0.5, 20.0
"""Largest distance of an image from the pose that it was taken for."""


@dataclass(frozen=True, slots=True)
class SampledMean:
    """The mean real error of a run in metres over the poses that the `planned` ones stand for.

    It is that of the localised ones of the `taken` images.
    """

    planned: int
    taken: int
    mean: Interval

    @property
    def text(self) -> str:
        """The mean as a sentence, and how many images at random poses would be as exact."""
        value = "-" if math.isnan(self.mean.value) else f"{self.mean.value:.2f} m"
        text = (
            f"mean real error over the free floor {value} ({self.mean.bounds_text(unit='m')}): "
            f"{self.taken} images within "
            f"{MATCH_METRES:g} m and {MATCH_DEGREES:g} degrees of {self.planned} sampled poses"
        )
        if self.mean.sample is None:
            return text
        return f"{text}; as exact as about {self.mean.sample.effective_n:.0f} at random poses"

    def as_json(self) -> dict[str, Any]:
        """The mean as JSON data."""
        return {"planned": self.planned, "taken": self.taken, "mean_error_m": self.mean.as_json()}


def sampled_mean(store: Store, run: str, poses: Sequence[PlannedPose]) -> SampledMean:
    """The mean real error from the images at the poses of a sample, in its order.

    An image counts for the nearest pose, one for each, with or without a sim image. Images that the
    model was trained on do not count.
    """
    columns = store.run_columns(run)
    truth = store.poses(store.run(run).real_domain)
    counts = applied_to(columns.real) & ~columns.trained & np.isfinite(truth).all(axis=1)
    images = store.in_recording_order(counts)
    wanted = np.array([(p.x_m, p.y_m, math.radians(p.heading_deg)) for p in poses]).reshape(-1, 3)
    rows = _nearest(wanted, truth[images])
    errors = columns.real.error[images[rows[rows >= 0]]].astype(np.float64)
    mean = intervals.stratified_mean(errors[np.isfinite(errors)])
    return SampledMean(len(poses), int(np.count_nonzero(rows >= 0)), mean)


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
