"""Low-dimensional samples for the divergence: principal components and predictions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store

Floats = NDArray[np.float64]

_EVEN = np.pi / np.sqrt(3)
"""Standard deviation of uniformly distributed headings, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class PairedSamples:
    """Samples (n, d) of both sides of the same instances; rows with NaN are unknown.

    `periods` (d,) are the periods of angular coordinates, 0 for the others.
    """

    sim: Floats
    real: Floats
    periods: Floats


def principal_components(sim: Floats, real: Floats, count: int) -> PairedSamples:
    """Projections of features (n, d) on their first `count` pooled principal components."""
    points = np.concatenate([real, sim])
    centred = points - points.mean(axis=0)
    if len(points) < points.shape[1]:
        values, vectors = np.linalg.eigh(centred @ centred.T)
        scores = (vectors[:, ::-1] * np.sqrt(np.maximum(values[::-1], 0)))[:, :count]
    else:
        _, directions = np.linalg.eigh(centred.T @ centred)
        scores = centred @ directions[:, ::-1][:, :count]
    return PairedSamples(scores[len(real) :], scores[: len(real)], np.zeros(scores.shape[1]))


def prediction_samples(store: Store, run: str, iids: NDArray[np.int64]) -> dict[str, PairedSamples]:
    """Predictions of a run for both sides, each coordinate in units of its standard deviation.

    `poses` are (x, y, heading), `errors` are (position, heading) errors; headings are left out
    where the run predicts none. Empty for a run that is not computed.
    """
    if store.run(run).key is None:
        return {}
    columns = store.run_columns(run)
    sides = (columns.sim, columns.real)
    x, y, heading, error, heading_error = (
        np.stack([np.asarray(getattr(side, name), dtype=np.float64)[iids] for side in sides])
        for name in ("x", "y", "heading", "error", "heading_error")
    )
    position_spread = np.hypot(_spread(x), _spread(y)) / np.sqrt(2)
    heading_spread = _circular_spread(heading)
    samples = {
        "poses": _joined(
            [x / position_spread, y / position_spread, heading / heading_spread],
            [0.0, 0.0, 2 * np.pi / heading_spread],
        ),
        "errors": _joined(
            [error / _spread(error), heading_error / _spread(heading_error)], [0.0, 0.0]
        ),
    }
    return {name: each for name, each in samples.items() if each.periods.size}


def _joined(columns: list[Floats], periods: list[float]) -> PairedSamples:
    """Samples from the columns (2, n) that have finite values on both sides."""
    known = [k for k, each in enumerate(columns) if np.isfinite(each).any(axis=1).all()]
    sides = np.stack([columns[k] for k in known], axis=-1) if known else np.zeros((2, 0, 0))
    return PairedSamples(sides[0], sides[1], np.array([periods[k] for k in known]))


def _spread(values: Floats) -> float:
    """Standard deviation of the finite values; 1 where it is 0 or unknown."""
    known = values[np.isfinite(values)]
    spread = float(known.std()) if known.size else 0.0
    return spread if spread > 0 else 1.0


def _circular_spread(angles: Floats) -> float:
    """Circular standard deviation sqrt(-2 ln |mean direction|), rad, at most `_EVEN`; 1 if 0."""
    known = angles[np.isfinite(angles)]
    length = abs(np.exp(1j * known).mean()) if known.size else 1.0
    if length >= 1.0:
        return 1.0
    return float(min(np.sqrt(-2 * np.log(max(length, 1e-9))), _EVEN))
