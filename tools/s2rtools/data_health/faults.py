"""Rules that find faults from the measures of images, poses and times.

A rule compares an image with its neighbours in the recording, so that rooms of little texture or
light are no faults. To add a rule, write a function below, add it to `RULES`, and its meaning to
`s2rstore.image_faults`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import angles
from s2rstore.image_faults import (
    ALIKE,
    BLURRED,
    BRIGHT,
    DARK,
    FAR,
    FAULTS,
    HOLES,
    MISPAIRED,
    MOVED,
    POSE_JUMP,
    SAME_POSE,
    SATURATED,
    SMALLEST_JUMP,
    STILL,
    TIME_JUMP,
)
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rstore.language.canonical_text import to_text
from s2rstore.language.syntax_tree import Ids
from s2rstore.reader import Store
from s2rstore.records import SIDES, SPLITS, TRAINING_SPLITS
from s2rtools.common.command_line.progress import Reporter
from s2rtools.data_health.measures import Floats, ImageMeasures, measure_domain

Mask = NDArray[np.bool_]
_NEIGHBOURS = 7
"""Images before and after one that say how sharp it should be."""
_BLOCK = 256
"""Pairs that are compared with all images at once."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What the rules look at: measures of a domain, poses (N, 3), times (N,) and trajectories (N,).

    The instances of a trajectory follow each other. A time is NaN where none is known. splits: of
    each run on the domain, the images (N,) that it was trained on, and those that evaluate it. sim:
    measures of the sim images that are paired with those of a real domain.
    """

    images: ImageMeasures
    poses: Floats
    times: Floats
    trajectories: NDArray[np.integer]
    splits: Sequence[tuple[Mask, Mask]] = ()
    sim: ImageMeasures | None = None

    @property
    def follows(self) -> Mask:
        """(N,) whether the instance before is of the same trajectory."""
        found = np.zeros(len(self.trajectories), dtype=np.bool_)
        found[1:] = self.trajectories[1:] == self.trajectories[:-1]
        return found & (self.trajectories >= 0)

    def of_trajectory(self, values: Floats, statistic: Callable[[Floats], float]) -> Floats:
        """(N,) a statistic of the known values (N,) of each instance's trajectory, NaN for none."""
        found = np.full(values.size, np.nan)
        for code in np.unique(self.trajectories):
            rows = self.trajectories == code
            known = values[rows & np.isfinite(values)]
            if known.size:
                found[rows] = statistic(known)
        return found

    def steps(self) -> tuple[Floats, Floats]:
        """Metres and radians from the instance before, (N,); NaN for the first of a trajectory."""
        moved, turned = np.full((2, len(self.poses)), np.nan)
        moved[1:] = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        turned[1:] = np.abs(angles.wrap(np.diff(self.poses[:, 2])))
        moved[~self.follows], turned[~self.follows] = np.nan, np.nan
        return moved, turned

    @cached_property
    def stays(self) -> Mask:
        """(N,) whether the pose is that of the instance before."""
        moved, turned = self.steps()
        return (moved < MOVED[0]) & (turned < MOVED[1])

    @cached_property
    def alike(self) -> NDArray[np.intp]:
        """(P, 2) ascending pairs of images that show the same, at nearly one pose or far apart;
        without a blank wall, which looks like any other, and without those of a robot that stays.
        """
        known = np.isfinite(self.images.sharpness) & ~self.stays
        kept = [np.empty((0, 2), np.intp)]
        for pairs in _alike_pairs(self.images.signature, known & np.isfinite(self.poses[:, 0])):
            metres, _ = self.distances(pairs)
            kept.append(pairs[(metres >= FAR) | (metres < max(SAME_POSE[0], MOVED[0]))])
        return np.concatenate(kept)

    def distances(self, pairs: NDArray[np.intp]) -> tuple[Floats, Floats]:
        """Metres and radians between the poses of pairs (P, 2)."""
        offset = self.poses[pairs[:, 0]] - self.poses[pairs[:, 1]]
        return np.hypot(offset[:, 0], offset[:, 1]), np.abs(angles.wrap(offset[:, 2]))


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """One of `FAULTS` in a domain: the instances (n,) that show it, their share of the images."""

    name: str
    domain: str
    iids: NDArray[np.intp]
    share: float

    def mask(self, count: int) -> Mask:
        """(count,) whether each instance shows it."""
        found = np.zeros(count, dtype=np.bool_)
        found[self.iids] = True
        return found

    @property
    def expression(self) -> str:
        """The expression that selects the instances: `ids(3, 7..12)`."""
        return to_text(Ids.of(self.iids))

    def as_json(self) -> dict[str, Any]:
        """The fault as JSON data."""
        return {
            "fault": self.name, "domain": self.domain, "n": self.iids.size,
            "share": round(self.share, 6), "meaning": FAULTS[self.name],
            "expression": self.expression,
        }  # fmt: skip


def blurred(recorded: Recorded) -> Mask:
    sharpness = recorded.images.sharpness
    return sharpness < BLURRED * _median_of_neighbours(sharpness, recorded.trajectories)


def dark(recorded: Recorded) -> Mask:
    return recorded.images.dark >= DARK


def bright(recorded: Recorded) -> Mask:
    return recorded.images.bright >= BRIGHT


def frozen(recorded: Recorded) -> Mask:
    moved, turned = recorded.steps()
    changes = (moved >= MOVED[0]) | (turned >= MOVED[1])
    return changes & (recorded.images.change < STILL)


def repeated(recorded: Recorded) -> Mask:
    """Images whose content another instance has, further away than neighbours are."""
    pairs = np.array(list(_equal_pairs(recorded.images.content)), np.intp).reshape(-1, 2)
    metres, _ = recorded.distances(pairs)
    return _members(recorded, pairs[(metres >= MOVED[0]) & (np.diff(pairs)[:, 0] > 1)])


def misplaced(recorded: Recorded) -> Mask:
    """Images that show the same as one whose pose is far away."""
    metres, _ = recorded.distances(recorded.alike)
    return _members(recorded, recorded.alike[metres >= FAR]) & ~repeated(recorded)


def mispaired(recorded: Recorded) -> Mask:
    """Real images whose sim image is much more similar to the real image of another place."""
    found = np.zeros(len(recorded.poses), dtype=np.bool_)
    if recorded.sim is None:
        return found
    paired = np.flatnonzero((recorded.images.content > 0) & (recorded.sim.content > 0))
    if not paired.size:
        return found
    sim, real = (_centred(each.edges[paired]) for each in (recorded.sim, recorded.images))
    own = np.einsum("nd,nd->n", sim, real)
    doubted = np.flatnonzero(own < MISPAIRED[0] * np.median(own))
    for rows in np.split(doubted, range(_BLOCK, doubted.size, _BLOCK)):
        others = sim[rows] @ real.T
        offset = recorded.poses[paired[rows], None, :2] - recorded.poses[None, paired, :2]
        others[np.hypot(offset[..., 0], offset[..., 1]) < FAR] = -np.inf
        found[paired[rows]] = others.max(axis=1) > own[rows] + MISPAIRED[1]
    return found


def duplicate(recorded: Recorded) -> Mask:
    """Images that show the same as an earlier one at the same pose."""
    pairs = [recorded.alike]
    before = np.flatnonzero(recorded.stays) - 1
    bits = np.bitwise_count(recorded.images.signature[before + 1]
                            ^ recorded.images.signature[before])  # fmt: skip
    pairs.append(np.stack([before, before + 1], axis=1)[(bits <= ALIKE).all(axis=1)])
    joined = np.concatenate(pairs)
    metres, radians = recorded.distances(joined)
    found = np.zeros(len(recorded.poses), dtype=np.bool_)
    found[joined[(metres < SAME_POSE[0]) & (radians < SAME_POSE[1]), 1]] = True
    return found


def leaked(recorded: Recorded) -> Mask:
    """Images that evaluate a run which was trained on nearly the same image at nearly the pose."""
    metres, radians = recorded.distances(recorded.alike)
    pairs = recorded.alike[(metres < MOVED[0]) & (radians < MOVED[1])]
    found = np.zeros(len(recorded.poses), dtype=np.bool_)
    for trained, evaluated in recorded.splits:
        for one, other in (pairs.T, pairs.T[::-1]):
            found[one[evaluated[one] & trained[other]]] = True
    return found


def depth_holes(recorded: Recorded) -> Mask:
    return recorded.images.holes >= HOLES


def depth_saturated(recorded: Recorded) -> Mask:
    return recorded.images.saturated >= SATURATED


def time_jumps(recorded: Recorded) -> Mask:
    steps = np.full(len(recorded.times), np.nan)
    steps[1:] = np.diff(recorded.times)
    steps[~recorded.follows] = np.nan
    forward = np.where(steps > 0, steps, np.nan)
    usual = recorded.of_trajectory(forward, lambda known: float(np.median(known)))
    return np.isfinite(steps) & ((steps <= 0) | (steps > TIME_JUMP * usual))


def pose_jumps(recorded: Recorded) -> Mask:
    moved, _ = recorded.steps()
    usual = recorded.of_trajectory(moved, lambda known: float(np.percentile(known, 90)))
    return moved > np.maximum(POSE_JUMP * usual, SMALLEST_JUMP)


RULES: dict[str, Callable[[Recorded], Mask]] = {
    "blurred": blurred,
    "dark": dark,
    "bright": bright,
    "frozen": frozen,
    "repeated": repeated,
    "misplaced": misplaced,
    "mispaired": mispaired,
    "duplicate": duplicate,
    "leaked": leaked,
    "depth_holes": depth_holes,
    "depth_saturated": depth_saturated,
    "time_jump": time_jumps,
    "pose_jump": pose_jumps,
}
"""Rules by the name of the fault in `FAULTS`."""


def faults(recorded: Recorded, domain: str) -> Iterator[Fault]:
    """The faults of the images of a domain, those of `RULES` that occur."""
    imaged = recorded.images.content > 0
    for name, rule in RULES.items():
        iids = np.flatnonzero(rule(recorded) & imaged)
        if iids.size:
            yield Fault(name, domain, iids, iids.size / np.count_nonzero(imaged))


def check_store(store: Store, domains: Sequence[str], progress: Reporter) -> list[Fault]:
    """The faults of the images of some domains, and of their poses and times.

    Raises RequestError for an unknown domain.
    """
    compared = {domain: _paired_domain(store, domain) for domain in dict.fromkeys(domains)}
    measured: dict[str, ImageMeasures] = {}
    for name in dict.fromkeys([*compared, *filter(None, compared.values())]):
        progress.begin(f"images of {name}", sum(map(len, store.imaged_ranges(name))))
        measured[name] = measure_domain(store, name, progress.advance)
    found: list[Fault] = []
    truth = store.instances
    for domain, sim in compared.items():
        poses = store.poses(domain) if store.has_poses else np.full((len(truth), 3), np.nan)
        recorded = Recorded(
            measured[domain], poses, truth.timestamp, truth.trajectory, _splits(store, domain),
            measured[sim] if sim else None,
        )  # fmt: skip
        found += faults(recorded, domain)
    return found


def _paired_domain(store: Store, domain: str) -> str:
    """The sim domain that runs compare with a real one, or else the first; empty for others."""
    if store.domain(domain).kind != "real" or not store.has_poses:
        return ""
    compared = (run.domain("sim") for run in store.runs.values() if run.domain("real") == domain)
    sims = (name for name, each in store.domains.items() if each.kind == "sim")
    return next(compared, next(sims, ""))


def record_faults(root: Path, images: Mapping[str, int], found: Sequence[Fault]) -> None:
    """Publish the faults of domains, in place of earlier ones, with how many images were checked.

    Raises RequestError where the store cannot be written.
    """
    with edit(root) as draft:
        for domain in images:
            draft.delete("frame_fault", domain=domain)
        for fault in found:
            size = fault.iids.size
            draft.insert("frame_fault", {"iid": fault.iids.astype(np.int32),
                                         "domain": [fault.domain] * size,
                                         "fault": [fault.name] * size})  # fmt: skip
        draft.set_provenance(schema.HEALTH, {name: str(images[name]) for name in images})


def _splits(store: Store, domain: str) -> list[tuple[Mask, Mask]]:
    """The images of a domain that each run was trained on, and those that evaluate it."""
    found = []
    for name, run in store.runs.items():
        for side in SIDES if run.key else ():
            codes = getattr(store.run_columns(name), side).split
            is_trained = np.isin(codes, [SPLITS.index(split) for split in TRAINING_SPLITS])
            if run.domain(side) == domain and is_trained.any():
                found.append((is_trained, (codes >= 0) & ~is_trained))
    return found


def _members(recorded: Recorded, pairs: NDArray[np.intp]) -> Mask:
    """(N,) whether an image is in any of some pairs (P, 2)."""
    found = np.zeros(len(recorded.poses), dtype=np.bool_)
    found[pairs.ravel()] = True
    return found


def _centred(edges: NDArray[np.float16]) -> NDArray[np.float32]:
    """Layouts (n, D) without what all have in common, each of length 1."""
    values = edges.astype(np.float32) - edges.mean(axis=0, dtype=np.float32)
    return np.asarray(values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), 1e-6))


def _median_of_neighbours(values: Floats, trajectories: NDArray[np.integer]) -> Floats:
    """Median of each value's neighbours in its trajectory, without itself; NaN without any."""
    found = np.full(values.size, np.nan)
    for code in np.unique(trajectories):
        rows = np.flatnonzero(trajectories == code)
        padded = np.pad(values[rows], _NEIGHBOURS, constant_values=np.nan)
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _NEIGHBOURS + 1)
        others = np.delete(windows, _NEIGHBOURS, axis=1)
        known = np.isfinite(others).any(axis=1)
        found[rows[known]] = np.nanmedian(others[known], axis=1)
    return found


def _equal_pairs(codes: NDArray[np.unsignedinteger]) -> Iterator[tuple[int, int]]:
    """Pairs of rows with the same code, each row with the first of its code; 0 is no code."""
    order = np.argsort(codes, kind="stable")
    ordered = codes[order]
    starts = np.flatnonzero(np.append(True, ordered[1:] != ordered[:-1]))
    for start, stop in zip(starts, [*starts[1:], codes.size], strict=True):
        if codes[order[start]]:
            yield from ((int(order[start]), int(row)) for row in order[start + 1 : stop])


def _alike_pairs(signatures: NDArray[np.uint64], known: Mask) -> Iterator[NDArray[np.intp]]:
    """Pairs (P, 2) of known rows whose signatures (N, 2) differ in at most `ALIKE` bits per half.

    Of four parts of a half, at least one is equal in such a pair; the first one gives the pair.
    """
    rows = np.flatnonzero(known)
    shifts = np.arange(0, 64, 16, dtype=np.uint64)
    parts = ((signatures[:, :1] >> shifts) & np.uint64(0xFFFF)).astype(np.uint16)
    for part in range(len(shifts)):
        order = rows[np.argsort(parts[rows, part], kind="stable")]
        for members in np.split(order, np.flatnonzero(np.diff(parts[order, part])) + 1):
            for at, first in enumerate(members[:-1]):
                others = members[at + 1 :]
                bits = np.bitwise_count(signatures[others] ^ signatures[first])
                is_given = (parts[others, :part] == parts[first, :part]).any(axis=1)
                alike = others[(bits <= ALIKE).all(axis=1) & ~is_given]
                yield np.stack([np.full(alike.size, first), alike], axis=1)
