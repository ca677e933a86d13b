"""Kullback-Leibler divergence of principal components and of predictions.

It is estimated from distances to nearest neighbours. Source: Wang, Kulkarni and Verdu, "Divergence
estimation for multidimensional densities via k-nearest-neighbor distances", IEEE Trans. Inf.
Theory, 2009, eq. 14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import digamma

from s2rstore.reader import Store

Floats = NDArray[np.float64]

_EVEN = np.pi / np.sqrt(3)
"""Standard deviation of uniformly distributed headings, rad."""
MOST_DIMENSIONS = 3
NEIGHBOURS = 5


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
    """Pair the columns in which each of the two sides has a finite value."""
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


@dataclass(frozen=True, slots=True)
class Divergences:
    """Both directions, in nats; estimates of small divergences may fall below 0."""

    forward: float
    backward: float


def bias_warning(dimensions: int) -> str | None:
    """Warning for a divergence in more than 3 dimensions, else None."""
    if dimensions <= MOST_DIMENSIONS:
        return None
    return (
        f"nearest-neighbour divergence in {dimensions} dimensions is strongly biased; "
        f"use at most {MOST_DIMENSIONS}"
    )


def divergences(
    x: Floats, y: Floats, neighbours: int = NEIGHBOURS, periods: Floats | None = None
) -> Divergences:
    """D(X || Y) and D(Y || X) of samples (n, d) and (m, d); infinite for discrete samples.

    `periods` (d,) are the periods of angular coordinates, 0 for the others. The estimate converges
    slowly: in 3 dimensions it was 0.1 off at n = 500 and 0.02 at 50,000; above 3 see
    `bias_warning`.
    """
    circular = np.zeros(x.shape[1]) if periods is None else periods
    x, y = _wrapped(x, circular), _wrapped(y, circular)
    return Divergences(
        _divergence(x, y, neighbours, circular), _divergence(y, x, neighbours, circular)
    )


def _wrapped(points: Floats, periods: Floats) -> Floats:
    """Angular coordinates wrapped into [0, period)."""
    wrapped = points.copy()
    for column in np.flatnonzero(periods > 0):
        remainder = np.mod(points[:, column], periods[column])
        wrapped[:, column] = np.where(remainder < periods[column], remainder, 0.0)
    return wrapped


def _divergence(x: Floats, y: Floats, neighbours: int, periods: Floats) -> float:
    """d / n sum log(nu_k / rho_k) + log(m / (n - 1)).

    Where duplicates give a distance of 0, k grows for both distances until they are above 0 (the
    paper's data-dependent k_i with its digamma terms); where rho is 0 for all k the sample has no
    density and the divergence is infinite.
    """
    n, m = len(x), len(y)
    most = min(n - 1, m)
    if most < neighbours:
        raise ValueError(f"{neighbours} neighbours need {neighbours + 1} samples of each")
    inside = _distances(x, x, neighbours + 1, periods)[:, 1:]
    across = _distances(y, x, neighbours, periods)
    rho, nu = inside[:, -1], across[:, -1]
    bad = (rho <= 0) | (nu <= 0)
    k_in = np.full(n, neighbours)
    k_out = np.full(n, neighbours)
    if bad.any():
        rho[bad], k_in[bad] = _first_positive(x, x[bad], periods, includes_self=True)
        nu[bad], k_out[bad] = _first_positive(y, x[bad], periods, includes_self=False)
    if (rho <= 0).any() or (nu <= 0).any():
        return 0.0 if (rho <= 0).all() and (nu <= 0).all() else float("inf")
    scale = x.shape[1] * np.log(nu / rho) + digamma(k_in) - digamma(k_out)
    return float(scale.mean() + np.log(m / (n - 1)))


def _distances(samples: Floats, points: Floats, count: int, periods: Floats) -> Floats:
    tree = cKDTree(samples, boxsize=periods if periods.any() else None)
    distances, _ = tree.query(points, k=np.arange(1, count + 1))
    return np.asarray(distances, dtype=np.float64)


def _first_positive(
    samples: Floats, points: Floats, periods: Floats, includes_self: bool
) -> tuple[Floats, NDArray[np.int64]]:
    """Smallest positive distance of each point, 0 if none, and the number of samples within it.

    The point itself is not counted where `samples` include it.
    """
    distances = _distances(samples, points, len(samples), periods)
    positive = distances > 0
    first = positive.argmax(axis=1)
    rho = np.where(positive.any(axis=1), distances[np.arange(len(points)), first], 0.0)
    within = (distances <= rho[:, None]).sum(axis=1) - int(includes_self)
    return rho, np.maximum(within, 1)
