"""Plan where to take a number of new real images of a data set."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.planned_poses import PlannedPose
from s2rstore.geometry import angles
from s2rstore.intervals import Interval
from s2rstore.language import to_text
from s2rstore.language.syntax_tree import Ids
from s2rstore.reader import Store
from s2rtools.data_collection.batch_choice import Batch, PoseCoverage, add_in_order, choose_batch
from s2rtools.data_collection.candidates import (
    CandidatePoses,
    Floats,
    PoseSimilarity,
    find_candidates,
)
from s2rtools.data_collection.expected_reduction import (
    Evidence,
    LocalValues,
    Method,
    local_values,
    read_evidence,
    reducible_interval,
)

if TYPE_CHECKING:
    from s2rtools.common.command_line.progress import Reporter
    from s2rtools.data_collection.rendered_views import CandidateRenderer, RenderedViews

MAX_BUDGET = 5000
DEFAULT_SIMILARITY = PoseSimilarity()


@dataclass(frozen=True, slots=True)
class CollectionRequest:
    """A number of poses to choose for a run; `seed` matters for the method `random` alone."""

    run: str
    budget: int = 60
    method: Method = "combined"
    seed: int = 0
    similarity: PoseSimilarity = DEFAULT_SIMILARITY

    def __post_init__(self) -> None:
        """Raises RequestError for values out of range."""
        check_request(self.budget, self.seed)
        if self.method not in get_args(Method):
            raise RequestError(
                f"--method {self.method}: must be one of {', '.join(get_args(Method))}"
            )

    @property
    def weighting(self) -> Method:
        """The method whose reducible error counts: `combined` for random poses."""
        return "combined" if self.method == "random" else self.method


def check_request(budget: int, seed: int) -> None:
    """Raise RequestError for a number of poses or a random seed out of range."""
    if not 1 <= budget <= MAX_BUDGET:
        raise RequestError(f"--budget {budget}: must be 1 to {MAX_BUDGET}")
    if seed < 0:
        raise RequestError(f"--seed {seed}: must be 0 or more")


@dataclass(frozen=True, slots=True, eq=False)
class CollectionPlan:
    """Chosen poses in the order of their choice, and what they are based on.

    `evidence` and `training_images` are counts of instances. `reducible` is the mean over all
    candidates of the error that images could remove (metres) with its interval, `covered` the share
    of it that the chosen poses and training images cover, `covered_before` that of training images.
    `nearest` (n,) are the iids of the evidence most similar to each pose. `views` are the rendered
    candidates, None without a renderer.
    """

    request: CollectionRequest
    poses: tuple[PlannedPose, ...]
    candidates: int
    places: int
    origin: str
    evidence: int
    training_images: int
    uses_harm: bool
    reducible: Interval
    covered: float
    covered_before: float
    nearest: NDArray[np.intp]
    views: RenderedViews | None

    @property
    def expression(self) -> str:
        """Selects the instances that are the nearest to the poses."""
        return to_text(Ids(_ranges(np.unique(self.nearest))))

    def counts_by_room(self) -> list[tuple[str, int]]:
        """Rooms with the number of their poses, the largest first."""
        names, counts = np.unique([pose.room for pose in self.poses], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return [(str(names[k]) or "no room", int(counts[k])) for k in order]


def plan_collection(
    store: Store, request: CollectionRequest, reporter: Reporter | None = None,
    renderer: CandidateRenderer | None = None,
) -> CollectionPlan:  # fmt: skip
    """Choose poses for new real images of a computed run.

    With a `renderer`, the best candidates are rendered, and the poses are chosen among their
    usable views. Raises RequestError where the store has no poses, the run no new instances, or the
    renderer cannot be used.
    """
    evidence = read_evidence(store, request.run)
    candidates = find_candidates(store, reporter=reporter)
    if reporter is not None:
        reporter.say(f"choosing {request.budget} of {candidates.count:,} poses")
    values = local_values(candidates, evidence, request.similarity)
    views, among = None, None
    if renderer is not None:
        from s2rtools.data_collection.rendered_views import VIEWS_PER_POSE, render_views

        wider = replace(request, budget=min(VIEWS_PER_POSE * request.budget, MAX_BUDGET))
        cells = choose_poses(candidates, evidence, values, wider).cells
        run = store.run(request.run)
        views = render_views(store, run, renderer, candidates, cells, reporter)
        candidates = candidates.without(cells[~views.usable])
        values = local_values(candidates, evidence, request.similarity, views)
        among = cells[views.usable]
    batch = choose_poses(candidates, evidence, values, request, among)
    cells = batch.cells
    poses, rooms = candidates.poses(cells), candidates.rooms_of(cells)
    alike = request.similarity.of_poses(poses, rooms, evidence.poses, evidence.rooms)
    distance = np.hypot(*(poses[:, None, :2] - evidence.poses[:, :2]).transpose(2, 0, 1))
    # Where nothing is similar, the nearest position counts.
    nearest = np.where(alike.max(axis=1) > 0, alike.argmax(axis=1), distance.argmin(axis=1))
    names = (*store.instances.room_names, "")
    reasons = [_reason(values, cell, evidence) for cell in cells.tolist()]
    planned = planned_poses(candidates, cells, names, batch.gains.tolist(), reasons)
    total = max(batch.total, 1e-12)
    return CollectionPlan(
        request=request,
        poses=planned,
        candidates=candidates.count,
        places=len(candidates.places),
        origin=candidates.origin,
        evidence=len(evidence),
        training_images=len(evidence.trained_poses),
        uses_harm=evidence.harm is not None,
        reducible=reducible_interval(candidates, evidence, request.similarity, "combined", views),
        covered=(batch.covered + float(batch.gains.sum())) / total,
        covered_before=batch.covered / total,
        nearest=evidence.iids[nearest],
        views=views,
    )


def planned_poses(
    candidates: CandidatePoses, cells: NDArray[np.intp], rooms: Sequence[str],
    gains: Sequence[float], reasons: Sequence[str],
) -> tuple[PlannedPose, ...]:  # fmt: skip
    """The poses of flat indices (n,) with the gain, NaN for none, and the reason of each.

    `rooms` are the names of the rooms, the last one that of places in none.
    """
    return tuple(
        PlannedPose(
            round(x, 3), round(y, 3), round(math.degrees(angles.wrap(heading)), 1), rooms[room],
            float(f"{gain:.4g}"), reason,
        )
        for (x, y, heading), room, gain, reason in zip(
            candidates.poses(cells).tolist(), candidates.rooms_of(cells).tolist(), gains, reasons,
            strict=True,
        )
    )  # fmt: skip


def choose_poses(
    candidates: CandidatePoses, evidence: Evidence, values: LocalValues, request: CollectionRequest,
    among: NDArray[np.intp] | None = None,
) -> Batch:  # fmt: skip
    """The batch of the request's method, with the gains of its weighting.

    Poses are chosen `among` some flat indices, by default all usable ones.
    """
    usable = np.flatnonzero(candidates.usable) if among is None else among
    reducible = values.reducible(request.weighting)
    coverage = PoseCoverage(candidates, reducible, request.similarity)
    if request.method != "uniform":
        coverage.add_images(evidence.trained_poses, evidence.trained_rooms)
    if request.method != "random":
        return choose_batch(coverage, usable, request.budget)
    rng = np.random.default_rng(request.seed)
    drawn = rng.choice(usable, min(request.budget, usable.size), replace=False)
    return add_in_order(coverage, drawn)


def _reason(values: LocalValues, cell: int, evidence: Evidence) -> str:
    """What was expected at a pose, such as `real error 3.4 m, sim error 0.9 m, novelty 1.3, n 7`.

    n is the number of instances near it, counted by similarity.
    """

    def at(column: Floats) -> float:
        return float(column.flat[cell])

    parts = [
        f"real error {at(values.real_error):.2f} m",
        f"sim error {at(values.sim_error):.2f} m",
        f"novelty {at(values.novelty):.2f}",
    ]
    if evidence.harm is not None:
        parts.append(f"harm {at(values.harm):.2f} of the mean")
    return ", ".join([*parts, f"n {at(values.support):.1f}"])


def _ranges(iids: NDArray[np.intp]) -> tuple[tuple[int, int], ...]:
    """Runs of consecutive iids (n,) in ascending order, as first and last."""
    breaks = np.flatnonzero(np.diff(iids) > 1)
    first, last = np.append(iids[:1], iids[breaks + 1]), np.append(iids[breaks], iids[-1:])
    return tuple(zip(first.tolist(), last.tolist(), strict=True))
