"""The figures that stand for a run: over the instances that its model was not trained on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore import stats
from s2rstore.reader import Store
from s2rstore.records import SPLITS, Side

_KNOWN = (SPLITS.index("train"), SPLITS.index("validation"))


@dataclass(frozen=True, slots=True)
class Headline:
    """One side of a run over `n` instances; errors in metres, accuracy with its interval.

    `trained_on` counts the instances that were left out because the model was fitted or chosen
    on them. Figures are NaN where n is 0.
    """

    n: int
    trained_on: int
    accuracy: stats.Interval
    mean_error: float
    median_error: float


def headline(
    store: Store, run: str, side: Side, members: NDArray[np.bool_] | None = None
) -> Headline:
    """Figures of a computed run's side, over `members` (N,) where given."""
    columns = store.run_columns(run)
    chosen = columns.valid if members is None else columns.valid & members
    part = columns.side(side)
    known = chosen & np.isin(part.split, _KNOWN)
    keep = chosen & ~known
    errors = part.error[keep]
    return Headline(
        n=int(keep.sum()),
        trained_on=int(known.sum()),
        accuracy=stats.bootstrap_mean(part.accuracy[keep]),
        mean_error=float(errors.mean()) if errors.size else float("nan"),
        median_error=float(np.median(errors)) if errors.size else float("nan"),
    )


def baseline(store: Store, members: NDArray[np.bool_] | None = None) -> float:
    """Mean accuracy of predicting the mean position for every instance."""
    truth = store.instances
    keep = slice(None) if members is None else members
    values = stats.baseline_accuracy(truth.x[keep], truth.y[keep], store.dataset.accuracy_scale)
    return float(values.mean()) if values.size else float("nan")
