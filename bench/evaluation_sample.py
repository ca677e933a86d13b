"""Whether `s2r collect --for evaluation` tells the mean real error better than random poses do.

In four buildings of the synthetic world, of which pretrained models have seen the first one alone,
the real error at each of 1,000 candidate poses is that of a pretrained model on the rendered image,
and their mean is the truth. A row of variance is that of the mean over a sample, in that of as many
different random poses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bench.budget import BudgetRow
from bench.support.collection_trial import Trial, TrialSettings
from s2rstore.intervals import stratified_mean
from s2rtools.data_collection.candidates import CandidatePoses
from s2rtools.data_collection.evaluation_sample import stratified_sample
from s2rtools.training.evaluation import pose_errors, predict

BUILDINGS = (1, 2, 3, 4)
SIZES = (100, 200)
CANDIDATES = 1000
LARGEST = 0.75
"""Largest variance in that of random poses."""
LEAST = 0.93
"""Least coverage at nominal 95 %."""
_REPEATS = 2000
_BIAS = 3.5
"""Largest mean of the samples' errors, in its standard error."""


def figures(buildings: tuple[int, ...] = BUILDINGS) -> Iterator[BudgetRow]:
    """Variance, bias and coverage in each building, by number of poses."""
    for building in buildings:
        candidates, errors = building_errors(building)
        every = errors[candidates.usable]
        truth = float(every.mean())
        for size in SIZES:
            rng = np.random.default_rng(building)
            means = [
                stratified_mean(errors.flat[stratified_sample(candidates, size, rng)])
                for _ in range(_REPEATS)
            ]
            values = np.array([mean.value for mean in means])
            hits = np.mean([mean.low <= truth <= mean.high for mean in means])
            noise = float(values.std()) / math.sqrt(_REPEATS)
            random = float(every.var()) / size * (1 - size / every.size)
            title = f"sample for evaluation, building {building}, {size} poses"
            width = float(np.mean([mean.high - mean.low for mean in means]))
            yield BudgetRow(f"{title}: variance", float(values.var()) / random, "ratio",
                            LARGEST, details={"mean_error_m": truth, "width_m": width})  # fmt: skip
            yield BudgetRow(f"{title}: bias", abs(float(values.mean()) - truth) / noise,
                            "standard errors", _BIAS)  # fmt: skip
            yield BudgetRow(f"{title}: coverage", float(hits), "coverage", LEAST, "at least")


def building_errors(building: int) -> tuple[CandidatePoses, NDArray[np.float64]]:
    """Candidates of a building, and the real error in metres at each, (P, H), NaN elsewhere."""
    trial = Trial(0, TrialSettings(building=building))
    usable = np.flatnonzero(trial.candidates.usable)
    rng = np.random.default_rng(building)
    left = rng.permutation(usable)[CANDIDATES:]
    candidates = trial.candidates.without(left)
    cells = np.flatnonzero(candidates.usable)
    poses = candidates.poses(cells)
    frames = trial.frames("real", poses, 40_000)
    predicted = predict(trial.model.network, trial.model.convention, frames, np.arange(len(cells)))
    errors = np.full(candidates.usable.shape, np.nan)
    errors.flat[cells] = pose_errors(predicted, poses)[0]
    return candidates, errors
