"""Metrics of a run, over the instances that its model was not trained on.

An instance is a pose: where the model was trained on one of its images, the instance is left out
on both sides, so that sim and real are compared on the same instances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.index.population import NEW_INSTANCES
from s2rstore.intervals import Interval
from s2rstore.metrics import pose_metrics
from s2rstore.reader import Store
from s2rstore.records import SPLITS, Side


@dataclass(frozen=True, slots=True)
class SideMetrics:
    """One side of a run over `n` instances; errors in metres, accuracy with its interval.

    `trained_on` counts the instances that are left out. Metrics are NaN where n is 0.
    """

    n: int
    trained_on: int
    accuracy: Interval
    mean_error: float
    median_error: float


def population(store: Store, *runs: str) -> NDArray[np.bool_]:
    """The instances that count in all of some computed runs, shape (N,); read-only.

    They are those that every run predicted on both sides and that are new to all of them.
    """
    return NEW_INSTANCES.mask(store.instances, *(store.run_columns(run) for run in runs))


def knows_training_set(store: Store, run: str) -> bool:
    """Whether the store knows which instances a computed run's model was trained on.

    It does not for weights and predictions of other programs that came without splits: all their
    instances are `unseen`, and count as new.
    """
    codes, model = store.run_columns(run).split, store.run(run).model
    if np.isin(codes, (-1, SPLITS.index("unseen")), invert=True).any():
        return True
    return model is not None and any(
        key.startswith("split:") for key in store.provenance(f"model:{model}")
    )


def side_metrics(
    store: Store, run: str, side: Side, members: NDArray[np.bool_] | None = None
) -> SideMetrics:
    """Metrics of one side of a computed run, over `members` (N,) or all instances."""
    columns = store.run_columns(run)
    chosen = columns.valid if members is None else columns.valid & members
    part = columns.side(side)
    keep = chosen & population(store, run)
    errors, ordered = part.error[keep], store.in_recording_order(keep)
    return SideMetrics(
        n=int(keep.sum()),
        trained_on=int(chosen.sum() - keep.sum()),
        accuracy=intervals.mean(
            part.accuracy[ordered], store.instances.trajectory[ordered]
        ).clipped(0.0, 1.0),
        mean_error=float(errors.mean()) if errors.size else float("nan"),
        median_error=float(np.median(errors)) if errors.size else float("nan"),
    )


def baseline_accuracy(
    store: Store, run: str, members: NDArray[np.bool_] | None = None, side: Side = "sim"
) -> float:
    """Mean accuracy of predicting the mean position of a run's held-out instances.

    Positions are those of the side's images. With `members` (N,) the accuracy is over these alone;
    the position stays the mean of all.
    """
    keep = population(store, run)
    values = pose_metrics.accuracy(constant_errors(store, run, side), store.dataset.accuracy_scale)
    values = values[keep if members is None else keep & members]
    return float(values.mean()) if values.size else float("nan")


def constant_errors(store: Store, run: str, side: Side) -> NDArray[np.float64]:
    """(N,) distance in metres of each instance to the mean position of a run's held-out ones.

    Positions are those of the side's images; NaN without a held-out instance.
    """
    keep = population(store, run)
    x, y = store.poses(store.run(run).domain(side))[:, :2].T
    if not keep.any():
        return np.full(x.size, np.nan)
    return np.asarray(np.hypot(x - x[keep].mean(), y - y[keep].mean()))
