"""A stratified sample of poses, whose real images tell the mean error over the candidates.

Candidates are put into an order that keeps similar poses together: rooms one after the other, and
in each room halves along the coordinate that spreads most, again and again, as in a k-d tree. The
order, a circle with a random start, is cut into as many strata of equal size as images (or one
candidate more), and a pose is drawn from each. Every candidate has the same probability, so that
the plain mean over the images is unbiased, whatever the errors are; its variance is what errors
differ within strata.

Source: Cochran, "Sampling techniques", 1977, chapter 5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.planned_poses import PoseSample
from s2rstore.reader import Store
from s2rtools.data_collection.candidates import CandidatePoses, Floats, find_candidates
from s2rtools.data_collection.plan import DEFAULT_SIMILARITY, check_request, planned_poses

if TYPE_CHECKING:
    from s2rtools.common.command_line.progress import Reporter

Cells = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class EvaluationSample:
    """A sample, neighbouring strata one after the other, of a number of candidates."""

    sample: PoseSample
    candidates: int
    places: int
    seed: int


def sample_store(
    store: Store, budget: int, seed: int, reporter: Reporter | None = None
) -> EvaluationSample:
    """A sample of `budget` candidate poses of a store.

    Raises RequestError for a budget above the number of candidates, and where the store has no
    poses.
    """
    check_request(budget, seed)
    candidates = find_candidates(store, reporter=reporter)
    cells = stratified_sample(candidates, budget, np.random.default_rng(seed))
    names = (*store.instances.room_names, "")
    poses = planned_poses(candidates, cells, names, [math.nan] * budget, [""] * budget)
    sample = PoseSample(poses, len(store.instances), candidates.origin)
    return EvaluationSample(sample, candidates.count, len(candidates.places), seed)


def stratified_sample(candidates: CandidatePoses, count: int, rng: np.random.Generator) -> Cells:
    """Different flat indices (count,) of usable candidates, one of each stratum.

    Neighbours are similar.
    """
    order = similar_order(candidates)
    if not 0 < count <= order.size:
        raise RequestError(f"--budget {count}: there are {order.size:,} candidates")
    borders = np.arange(count + 1) * order.size // count
    places = rng.integers(borders[:-1], borders[1:]) + rng.integers(order.size)
    return order[places % order.size]


def similar_order(candidates: CandidatePoses) -> Cells:
    """The usable candidates (n,), flat indices, in an order that keeps similar poses together."""
    cells = np.flatnonzero(candidates.usable)
    poses, rooms = candidates.poses(cells), candidates.rooms_of(cells)
    metres = DEFAULT_SIMILARITY.reach / DEFAULT_SIMILARITY.width  # that a radian counts as
    around = metres * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])])
    points = np.column_stack([poses[:, :2], around])
    parts = [_halved(points, np.flatnonzero(rooms == room)) for room in np.unique(rooms)]
    return cells[np.concatenate([np.empty(0, np.intp), *parts])]


def _halved(points: Floats, rows: Cells) -> Cells:
    """The rows of `points` (n, k) in the order of the leaves of a k-d tree."""
    if rows.size < 2:
        return rows
    inside = points[rows]
    ordered = rows[np.argsort(inside[:, inside.std(axis=0).argmax()], kind="stable")]
    middle = rows.size // 2
    return np.concatenate([_halved(points, ordered[:middle]), _halved(points, ordered[middle:])])
