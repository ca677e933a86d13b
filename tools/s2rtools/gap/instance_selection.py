"""Selection of the instances of an axis: selected, held out, and random subsets of whole blocks."""

from __future__ import annotations

import hashlib

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.intervals import Interval
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rtools.common.blocks import Blocks
from s2rtools.gap.axis import Evidence

Iids = NDArray[np.int64]


def selected(evidence: Evidence) -> Iids:
    """The selected iids, each once, as `Store.in_recording_order` gives them.

    Raises RequestError for iids that do not exist.
    """
    iids = np.unique(np.asarray(evidence.iids, dtype=np.int64))
    count = len(evidence.store.instances)
    if iids.size and not 0 <= iids[0] <= iids[-1] < count:
        raise RequestError(f"--select {evidence.expression}: the store holds iids 0 .. {count - 1}")
    return evidence.store.in_recording_order(iids)


def held_out(evidence: Evidence) -> Iids:
    """Selected iids that both sides predicted and that the model was not trained on."""
    iids = selected(evidence)
    return iids[run_metrics.population(evidence.store, evidence.run)[iids]]


def poses_sha256(store: Store) -> str:
    """SHA-256 of the ground-truth poses: equal for other images and models of the same poses.

    The numbers `seq` do not count, only the order inside a trajectory.
    """
    truth = store.instances
    digest = hashlib.sha256("\n".join(truth.trajectory_names).encode())
    places = _places(truth.trajectory).astype(truth.seq.dtype)
    for column in (truth.trajectory, places, truth.x, truth.y, truth.heading):
        digest.update(np.ascontiguousarray(column).tobytes())
    for domain in filter(store.has_own_poses, sorted(store.domains)):
        digest.update(domain.encode() + store.poses(domain).tobytes())
    return digest.hexdigest()


def _places(trajectory: NDArray[np.integer]) -> NDArray[np.intp]:
    """The place of each instance in its trajectory, from 0 on, (N,)."""
    order = np.argsort(trajectory, kind="stable")
    ordered = trajectory[order]
    places = np.empty(len(trajectory), dtype=np.intp)
    places[order] = np.arange(len(trajectory)) - np.searchsorted(ordered, ordered)
    return places


def uncomputed_reason(evidence: Evidence) -> str | None:
    """Message for a run without predictions, else None. Raises RequestError for unknown runs."""
    if evidence.store.run(evidence.run).key is None:
        return f"run {evidence.run!r} is not computed yet; run `s2r precompute`"
    return None


def require_instances(evidence: Evidence, iids: Iids, minimum: int) -> None:
    """Raises InconclusiveError for fewer than `minimum` instances."""
    if iids.size < minimum:
        raise InconclusiveError(
            f"{iids.size} usable instances of {evidence.expression!r}; at least {minimum} are "
            "needed"
        )


def sample_note(interval: Interval) -> str:
    """A note on what an interval rests on and is about, for the reader of a report."""
    if interval.sample is None:
        return f"no interval: {interval.reason}"
    return f"interval from {interval.text}, {interval.sample.scope}"


def random_blocks(blocks: Blocks, max_rows: int, seed: int) -> tuple[Iids, Blocks]:
    """Rows of seeded whole blocks, `max_rows` or slightly fewer, and the blocks of these rows."""
    order = np.random.default_rng(seed).permutation(blocks.count)
    chosen = np.sort(order[np.cumsum(blocks.sizes[order]) <= max_rows])
    sizes = np.diff(blocks.start)[chosen]
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    return blocks.rows(chosen), Blocks(start, blocks.trajectory[chosen])


def random_halves(blocks: Blocks, splits: int, seed: int) -> list[tuple[Iids, Iids]]:
    """Seeded random splits into two halves of whole blocks, as rows; all halves have one size.

    Blocks in random order join the smaller half, so that the halves differ by at most one block
    before the larger one is truncated: a half holds at least half of all rows less those of one
    block.
    """
    rng, sizes = np.random.default_rng(seed), blocks.sizes
    pairs = []
    for _ in range(splits):
        second, lead = np.zeros(blocks.count, dtype=np.bool_), 0.0
        for block in rng.permutation(blocks.count):
            second[block] = lead > 0
            lead += -sizes[block] if second[block] else sizes[block]
        pairs.append((blocks.rows(np.flatnonzero(~second)), blocks.rows(np.flatnonzero(second))))
    size = min(half.size for pair in pairs for half in pair)
    return [(a[:size], b[:size]) for a, b in pairs]
