"""Samples of a few dimensions whose divergence is told: components of features, and predictions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store

Floats = NDArray[np.float64]

_EVEN = np.pi / np.sqrt(3)
"""Standard deviation of headings in all directions alike, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Both sides (n, d) of the same instances; NaN rows are unknown.

    `periods` (d,) are those of coordinates on a circle, 0 for the others.
    """

    sim: Floats
    real: Floats
    periods: Floats


def principal(sim: Floats, real: Floats, count: int) -> Points:
    """Features (n, d) along their pooled directions of most variance, `count` or fewer."""
    points = np.concatenate([real, sim])
    centred = points - points.mean(axis=0)
    if len(points) < points.shape[1]:
        values, vectors = np.linalg.eigh(centred @ centred.T)
        found = (vectors[:, ::-1] * np.sqrt(np.maximum(values[::-1], 0)))[:, :count]
    else:
        _, directions = np.linalg.eigh(centred.T @ centred)
        found = centred @ directions[:, ::-1][:, :count]
    return Points(found[len(real) :], found[: len(real)], np.zeros(found.shape[1]))


def predicted(store: Store, run: str, iids: NDArray[np.int64]) -> dict[str, Points]:
    """What a run predicted of both sides, each coordinate in units of its spread.

    `poses` are (x, y, heading), `errors` (position, heading) ones; headings are left out where the
    run has none, all where it is not computed.
    """
    if store.run(run).key is None:
        return {}
    columns = store.run_columns(run)
    sides = (columns.sim, columns.real)
    x, y, heading, error, off = (
        np.stack([np.asarray(getattr(side, name), dtype=np.float64)[iids] for side in sides])
        for name in ("x", "y", "heading", "error", "heading_error")
    )
    places = np.hypot(_spread(x), _spread(y)) / np.sqrt(2)
    turn = _circular_spread(heading)
    found = {
        "poses": _joined([x / places, y / places, heading / turn], [0.0, 0.0, 2 * np.pi / turn]),
        "errors": _joined([error / _spread(error), off / _spread(off)], [0.0, 0.0]),
    }
    return {name: points for name, points in found.items() if points.periods.size}


def _joined(columns: list[Floats], periods: list[float]) -> Points:
    """Points of those columns (2, n) that both sides know something of."""
    known = [k for k, each in enumerate(columns) if np.isfinite(each).any(axis=1).all()]
    sides = np.stack([columns[k] for k in known], axis=-1) if known else np.zeros((2, 0, 0))
    return Points(sides[0], sides[1], np.array([periods[k] for k in known]))


def _spread(values: Floats) -> float:
    """Standard deviation of what is known; 1 where there is none."""
    known = values[np.isfinite(values)]
    spread = float(known.std()) if known.size else 0.0
    return spread if spread > 0 else 1.0


def _circular_spread(angles: Floats) -> float:
    """sqrt(-2 ln |mean direction|), rad, at most that of all directions alike; 1 where it is 0."""
    known = angles[np.isfinite(angles)]
    length = abs(np.exp(1j * known).mean()) if known.size else 1.0
    if length >= 1.0:
        return 1.0
    return float(min(np.sqrt(-2 * np.log(max(length, 1e-9))), _EVEN))
