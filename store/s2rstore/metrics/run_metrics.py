"""The figures that stand for a run: over the instances that its model was not trained on.

An instance is a pose: where the model learned from one of its images, the pose is known to it and
leaves the figures of both sides, so that sim and real are compared on the same instances.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.metrics import bootstrap, pose_metrics
from s2rstore.reader import Store
from s2rstore.records import SPLITS, Side

_KNOWN = (SPLITS.index("train"), SPLITS.index("validation"))


@dataclass(frozen=True, slots=True)
class Headline:
    """One side of a run over `n` instances; errors in metres, accuracy with its interval.

    `trained_on` counts the instances that were left out. Figures are NaN where n is 0.
    """

    n: int
    trained_on: int
    accuracy: bootstrap.Interval
    mean_error: float
    median_error: float


def held_out(store: Store, run: str) -> NDArray[np.bool_]:
    """The valid instances that the model was neither fitted nor chosen on, shape (N,)."""
    columns = store.run_columns(run)
    known = np.isin(columns.sim.split, _KNOWN) | np.isin(columns.real.split, _KNOWN)
    return np.asarray(columns.valid & ~known)


def headline(
    store: Store, run: str, side: Side, members: NDArray[np.bool_] | None = None
) -> Headline:
    """Figures of a computed run's side, over `members` (N,) where given."""
    columns = store.run_columns(run)
    chosen = columns.valid if members is None else columns.valid & members
    part = columns.side(side)
    keep = chosen & held_out(store, run)
    errors = part.error[keep]
    return Headline(
        n=int(keep.sum()),
        trained_on=int(chosen.sum() - keep.sum()),
        accuracy=bootstrap.mean_interval(
            part.accuracy[keep], store.instances.trajectory[keep]
        ).clipped(0.0, 1.0),
        mean_error=float(errors.mean()) if errors.size else float("nan"),
        median_error=float(np.median(errors)) if errors.size else float("nan"),
    )


def baseline(store: Store, run: str, members: NDArray[np.bool_] | None = None) -> float:
    """Mean accuracy of predicting their mean position for the instances of a run's figures.

    With `members` (N,) over these alone; the position stays the mean of all.
    """
    truth, keep = store.instances, held_out(store, run)
    values = pose_metrics.baseline_accuracy(
        truth.x[keep], truth.y[keep], store.dataset.accuracy_scale
    )
    values = values if members is None else values[members[keep]]
    return float(values.mean()) if values.size else float("nan")
