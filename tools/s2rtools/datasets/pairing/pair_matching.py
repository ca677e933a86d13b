"""One-to-one assignment of two sets of points: the pairs of smallest total cost.

Every point of one set is matched with at most one of the other, within a tolerance. Let c be the
cost of a pair and c_max the cost of a pair at the tolerance. The assignment minimises

    sum of c over the pairs + c_max / 2 for every point without partner,

so that a pair within the tolerance is always better than two points without partners, and a
shorter chain of close pairs is better than a longer one of distant pairs. This is the assignment
problem of the Hungarian method (Kuhn, Naval Research Logistics Quarterly 2, 1955) with a dummy
partner per point; components of the graph of candidates are solved apart.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching
from scipy.spatial import cKDTree

from s2rstore.geometry import angles

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
ReportProgress = Callable[[int], object]

MAX_CANDIDATES = 32
"""Nearest points of the other set that each point considers."""
_DENSE_CELLS = 1 << 16
"""Cells of the cost matrix of a component that is solved densely."""
_BLOCK = 8192
"""Points whose candidates are searched together."""
_JITTER = 1e-7
"""Metres that positions are displaced by, so that equal ones have different nearest points."""


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Possible pairs: rows of the first and the second set, and the cost of each, (K,)."""

    first: Rows
    second: Rows
    cost: Floats


@dataclass(frozen=True, slots=True)
class PoseTolerance:
    """Largest distance in metres and largest angle between headings in radians of a pair.

    The cost of a pair is its distance in metres plus `metres_per_radian` times its angle: at the
    tolerance the angle costs as much as the distance.
    """

    distance: float
    angle: float

    @property
    def metres_per_radian(self) -> float:
        return self.distance / self.angle

    @property
    def cost(self) -> float:
        """The cost of a pair at the tolerance."""
        return 2 * self.distance


def match_poses(
    first: Floats,
    second: Floats,
    tolerance: PoseTolerance,
    progress: ReportProgress = lambda points: None,
) -> tuple[Rows, Rows]:
    """Match poses (N, 3) and (M, 3), metres and radians; gives the rows of the pairs, (K,) each.

    The assignment is exact where no pose has more than `MAX_CANDIDATES` others within the
    tolerance. Where it has, as for a robot that stands still, the nearest ones are considered, and
    what is left is matched again until no further pair is found. `progress` is called with
    numbers of points whose candidates are known; they add up to N + M.
    """
    return _match(first, second, tolerance, tolerance.cost, progress)


def _match(
    first: Floats, second: Floats, tolerance: PoseTolerance, limit: float, progress: ReportProgress
) -> tuple[Rows, Rows]:
    """The pairs of `match_poses`; `limit` is c_max."""
    rows: tuple[list[Rows], list[Rows]] = [], []
    left = np.arange(len(first)), np.arange(len(second))
    report = progress
    while left[0].size and left[1].size:
        candidates, is_complete = _near_poses(first[left[0]], second[left[1]], tolerance, report)
        a, b = assign(candidates, (left[0].size, left[1].size), limit)
        rows[0].append(left[0][a])
        rows[1].append(left[1][b])
        left = np.delete(left[0], a), np.delete(left[1], b)
        report = _ignore
        if is_complete or not a.size:
            break
    return _ordered(rows)


def match_times(first: Floats, second: Floats, tolerance: float) -> tuple[Rows, Rows]:
    """Match times (N,) and (M,) in seconds within a tolerance; gives the rows of the pairs.

    The cost of a pair is the difference of its times. Points without a time (NaN) have no pair.
    """
    known = np.flatnonzero(np.isfinite(first)), np.flatnonzero(np.isfinite(second))
    poses, others = (
        np.column_stack([times[rows], np.zeros((rows.size, 2))])
        for times, rows in zip((first, second), known, strict=True)
    )
    a, b = _match(poses, others, PoseTolerance(tolerance, np.pi), tolerance, _ignore)
    return known[0][a], known[1][b]


def assign(candidates: Candidates, sizes: tuple[int, int], limit: float) -> tuple[Rows, Rows]:
    """The assignment of smallest total cost; gives rows of both sets, those of the first ascending.

    `sizes` are the numbers of points in both sets, `limit` is c_max: a pair of a higher cost is
    never made.
    """
    use = candidates.cost <= limit
    first, second, cost = candidates.first[use], candidates.second[use], candidates.cost[use]
    if not first.size:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    graph = coo_matrix((np.ones(first.size), (first, second + sizes[0])), shape=(sum(sizes),) * 2)
    _, labels = connected_components(graph, directed=False)
    order = np.argsort(labels[first], kind="stable")
    ends = np.flatnonzero(np.diff(labels[first][order])) + 1
    found: tuple[list[Rows], list[Rows]] = [], []
    large: list[Rows] = []
    for edges in np.split(order, ends):
        if edges.size == 1:
            a, b = first[edges], second[edges]
        else:
            rows, local_a = np.unique(first[edges], return_inverse=True)
            columns, local_b = np.unique(second[edges], return_inverse=True)
            if rows.size * columns.size > _DENSE_CELLS:
                large.append(edges)
                continue
            gain = np.zeros((rows.size, columns.size))
            gain[local_a, local_b] = _gain(cost[edges], limit)
            a, b = linear_sum_assignment(gain, maximize=True)
            is_pair = gain[a, b] > 0
            a, b = rows[a[is_pair]], columns[b[is_pair]]
        found[0].append(a)
        found[1].append(b)
    for edges in large:
        a, b = _assign_sparsely(first[edges], second[edges], _gain(cost[edges], limit))
        found[0].append(a)
        found[1].append(b)
    return _ordered(found)


def nearest_poses(points: Floats, others: Floats) -> tuple[Rows, Floats, Floats]:
    """The row of the nearest of `others` (M, 3) by position for each of `points` (N, 3).

    With its distance in metres and the angle between both headings in radians, (N,) each.
    """
    distance, rows = cKDTree(others[:, :2]).query(points[:, :2])
    return rows, distance, angles.distance(points[:, 2], others[rows, 2])


def _gain(cost: Floats, limit: float) -> Floats:
    """What a pair saves over two points without partners; above 0 also at the tolerance."""
    return limit * (1 + 1e-9) + 1e-12 - cost


def _assign_sparsely(first: Rows, second: Rows, gain: Floats) -> tuple[Rows, Rows]:
    """The pairs of largest total gain, by sparse shortest augmenting paths.

    Every point of the first set has a dummy partner without gain, so that a full matching exists.
    """
    rows, local_a = np.unique(first, return_inverse=True)
    columns, local_b = np.unique(second, return_inverse=True)
    n, m = rows.size, columns.size
    highest = 2 * gain.max()
    weights = csr_matrix(
        (
            np.concatenate([highest - gain, np.full(n, highest)]),
            (np.concatenate([local_a, np.arange(n)]), np.concatenate([local_b, m + np.arange(n)])),
        ),
        shape=(n, m + n),
    )
    a, b = min_weight_full_bipartite_matching(weights)
    is_pair = b < m
    return rows[a[is_pair]], columns[b[is_pair]]


def _near_poses(
    first: Floats, second: Floats, tolerance: PoseTolerance, progress: ReportProgress
) -> tuple[Candidates, bool]:
    """The candidates within the tolerance among the nearest ones of each pose of both sets.

    And whether there can be no others.
    """
    embedded = [_embedded(poses, tolerance, seed) for seed, poses in enumerate((first, second))]
    trees = [cKDTree(points) for points in embedded]
    chord = 2 * tolerance.metres_per_radian * np.sin(min(tolerance.angle, np.pi) / 2)
    reach = float(np.hypot(tolerance.distance, chord)) * (1 + 1e-6) + 4 * _JITTER
    found: list[Rows] = []
    is_complete = True
    for number, (points, tree) in enumerate(zip(embedded, reversed(trees), strict=True)):
        for start in range(0, len(points), _BLOCK):
            block = points[start : start + _BLOCK]
            k = min(MAX_CANDIDATES, tree.n)
            _, near = tree.query(block, k=np.arange(1, k + 1), distance_upper_bound=reach)
            is_complete &= k < MAX_CANDIDATES or bool((near[:, -1] == tree.n).all())
            own, place = np.nonzero(near < tree.n)
            pair = own + start, near[own, place].astype(np.intp)
            a, b = pair if number == 0 else pair[::-1]
            found.append((a * len(second) + b)[_is_near(first[a], second[b], tolerance)])
            progress(len(block))
    pairs = np.unique(np.concatenate(found))
    a, b = np.divmod(pairs, len(second))
    return Candidates(a, b, _cost(first[a], second[b], tolerance)), is_complete


def _embedded(poses: Floats, tolerance: PoseTolerance, seed: int) -> Floats:
    """Map poses to points (N, 4) for a KD-tree: position, then weighted heading vector."""
    jitter = np.random.default_rng(seed).uniform(-_JITTER, _JITTER, (len(poses), 2))
    directions = np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    return np.hstack([poses[:, :2] + jitter, tolerance.metres_per_radian * directions])


def _is_near(first: Floats, second: Floats, tolerance: PoseTolerance) -> NDArray[np.bool_]:
    distance = np.hypot(*(first - second)[:, :2].T)
    angle = angles.distance(first[:, 2], second[:, 2])
    rounding = 1e-9
    return (distance <= tolerance.distance + rounding) & (angle <= tolerance.angle + rounding)


def _cost(first: Floats, second: Floats, tolerance: PoseTolerance) -> Floats:
    distance = np.hypot(*(first - second)[:, :2].T)
    angle = angles.distance(first[:, 2], second[:, 2])
    cost = distance + tolerance.metres_per_radian * angle
    return np.minimum(cost, tolerance.cost)


def _ordered(rows: tuple[list[Rows], list[Rows]]) -> tuple[Rows, Rows]:
    a, b = (np.concatenate([np.empty(0, dtype=np.intp), *each]) for each in rows)
    order = np.argsort(a)
    return a[order], b[order]


def _ignore(points: int) -> None:
    pass
