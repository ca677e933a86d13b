"""Rules that find faults from the measures of images, poses and times.

A rule compares an image with its neighbours in the recording, so that rooms of little texture or
light are no faults. To add a rule, write a function below and add it to `RULES`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry import angles
from s2rstore.reader import Store
from s2rtools.common.command_line.progress import Reporter
from s2rtools.data_health.measures import Floats, ImageMeasures, measure_domain

Mask = NDArray[np.bool_]
_NEIGHBOURS = 7
"""Images before and after one that say how sharp it should be."""
BLURRED = 0.5
"""Sharpness in the median of the neighbours below which an image is blurred."""
DARK, BRIGHT = 0.7, 0.4
"""Shares of black and of white pixels from which an image is badly exposed."""
STILL = 0.15
"""Mean change of grey values (0 .. 255) below which an image equals the one before."""
MOVED = 0.05, math.radians(2)
"""Metres and radians between poses from which two images must differ."""
ALIKE = 3
"""Differing bits of each half of 64 up to which two images show the same."""
FAR = 2.0
"""Metres between poses from which images that show the same contradict the poses."""
HOLES, SATURATED = 0.6, 0.3
"""Shares of pixels without depth, and of depth at the end of its range."""
TIME_JUMP, POSE_JUMP = 5.0, 4.0
"""Steps, in the median step of time and in the 95th percentile of distance, that are jumps."""
SMALLEST_JUMP = 0.5
"""Metres below which no step is a jump."""


@dataclass(frozen=True, slots=True, eq=False)
class Recorded:
    """What the rules look at: measures of a domain, poses (N, 3), times (N,) and trajectories (N,).

    The instances of a trajectory follow each other. A time is NaN where none is known.
    """

    images: ImageMeasures
    poses: Floats
    times: Floats
    trajectories: NDArray[np.integer]

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


@dataclass(frozen=True, slots=True, eq=False)
class Fault:
    """A kind of fault in a domain: the instances (n,) that show it, and what it means.

    share: of the images of the domain.
    """

    name: str
    domain: str
    iids: NDArray[np.intp]
    meaning: str
    share: float

    def ranges(self) -> list[str]:
        """The instances as `3` and `7..12`."""
        runs = np.split(self.iids, np.flatnonzero(np.diff(self.iids) > 1) + 1)
        return [f"{run[0]}" if run.size == 1 else f"{run[0]}..{run[-1]}" for run in runs]

    @property
    def expression(self) -> str:
        """The expression that selects the instances: `ids(3, 7..12)`."""
        return f"ids({', '.join(self.ranges())})"

    def as_json(self) -> dict[str, Any]:
        """The fault as JSON data."""
        return {
            "fault": self.name, "domain": self.domain, "n": self.iids.size,
            "share": round(self.share, 6), "meaning": self.meaning,
            "expression": self.expression,
        }  # fmt: skip


def blurred(recorded: Recorded) -> Mask:
    sharpness = recorded.images.sharpness
    return sharpness < BLURRED * _median_of_neighbours(sharpness, recorded.trajectories)


def too_dark(recorded: Recorded) -> Mask:
    return recorded.images.dark >= DARK


def too_bright(recorded: Recorded) -> Mask:
    return recorded.images.bright >= BRIGHT


def frozen(recorded: Recorded) -> Mask:
    moved, turned = recorded.steps()
    changes = (moved >= MOVED[0]) | (turned >= MOVED[1])
    return changes & (recorded.images.change < STILL)


def repeated(recorded: Recorded) -> Mask:
    """Images whose content another instance has, further away than neighbours are."""
    found = np.zeros(len(recorded.poses), dtype=np.bool_)
    for first, second in _equal_pairs(recorded.images.content):
        if _distance(recorded, first, second) >= MOVED[0] and abs(first - second) > 1:
            found[[first, second]] = True
    return found


def misplaced(recorded: Recorded) -> Mask:
    """Images that show the same as one whose pose is far away."""
    moved, turned = recorded.steps()
    stays = (moved < MOVED[0]) & (turned < MOVED[1])
    known = np.isfinite(recorded.images.sharpness) & ~stays  # a blank wall looks like any other
    found = np.zeros(len(recorded.poses), dtype=np.bool_)
    for first, second in _alike_pairs(recorded.images.signature, known):
        if _distance(recorded, first, second) >= FAR:
            found[[first, second]] = True
    return found & ~repeated(recorded)


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
    usual = recorded.of_trajectory(moved, lambda known: float(np.percentile(known, 95)))
    return moved > np.maximum(POSE_JUMP * usual, SMALLEST_JUMP)


Rule = Callable[[Recorded], Mask]
RULES: dict[str, tuple[Rule, str]] = {
    "blurred": (blurred, f"sharpness below {BLURRED:g} of that of the neighbours"),
    "too dark": (too_dark, f"{DARK:.0%} of the pixels or more are black"),
    "too bright": (too_bright, f"{BRIGHT:.0%} of the pixels or more are white"),
    "frozen": (frozen, "equals the image before although the pose changed"),
    "repeated": (repeated, "the same image as at another pose"),
    "misplaced": (misplaced, f"shows the same as an image {FAR:g} m away or more"),
    "depth holes": (depth_holes, f"{HOLES:.0%} of the pixels or more have no valid depth"),
    "depth saturated": (depth_saturated, f"{SATURATED:.0%} of the depth or more is at the end of "
                        "its range"),
    "time jump": (time_jumps, "time stands still, goes back, or leaves out five steps"),
    "pose jump": (pose_jumps, "the step from the pose before is four times as long as usual"),
}  # fmt: skip
"""Rules by the name of the fault, with what they mean."""


def faults(recorded: Recorded, domain: str) -> Iterator[Fault]:
    """The faults of the images of a domain, those of `RULES` that occur."""
    imaged = recorded.images.content > 0
    for name, (rule, meaning) in RULES.items():
        iids = np.flatnonzero(rule(recorded) & imaged)
        if iids.size:
            yield Fault(name, domain, iids, meaning, iids.size / np.count_nonzero(imaged))


def check_store(store: Store, domains: Sequence[str], progress: Reporter) -> list[Fault]:
    """The faults of the images of some domains, and of their poses and times.

    Raises RequestError for an unknown domain.
    """
    found: list[Fault] = []
    truth = store.instances
    for domain in dict.fromkeys(domains):
        progress.begin(f"images of {domain}", sum(map(len, store.imaged_ranges(domain))))
        measures = measure_domain(store, domain, progress.advance)
        poses = store.poses(domain) if store.has_poses else np.full((len(truth), 3), np.nan)
        recorded = Recorded(measures, poses, truth.timestamp, truth.trajectory)
        found += faults(recorded, domain)
    return found


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


def _distance(recorded: Recorded, first: int, second: int) -> float:
    return float(np.hypot(*(recorded.poses[first, :2] - recorded.poses[second, :2])))


def _equal_pairs(codes: NDArray[np.unsignedinteger]) -> Iterator[tuple[int, int]]:
    """Pairs of rows with the same code, each row with the first of its code; 0 is no code."""
    order = np.argsort(codes, kind="stable")
    ordered = codes[order]
    starts = np.flatnonzero(np.append(True, ordered[1:] != ordered[:-1]))
    for start, stop in zip(starts, [*starts[1:], codes.size], strict=True):
        if codes[order[start]]:
            yield from ((int(order[start]), int(row)) for row in order[start + 1 : stop])


def _alike_pairs(signatures: NDArray[np.uint64], known: Mask) -> Iterator[tuple[int, int]]:
    """Pairs of known rows whose signatures (N, 2) differ in at most `ALIKE` bits of each half.

    Of four parts of a half, at least one is equal in such a pair.
    """
    seen: set[tuple[int, int]] = set()
    rows = np.flatnonzero(known)
    for part in range(4):
        keys = (signatures[rows, 0] >> np.uint64(16 * part)) & np.uint64(0xFFFF)
        for key in np.unique(keys):
            members = rows[keys == key]
            for at, first in enumerate(members[:-1].tolist()):
                others = members[at + 1 :]
                bits = np.bitwise_count(signatures[others] ^ signatures[first])
                for second in others[(bits <= ALIKE).all(axis=1)].tolist():
                    if (first, second) not in seen:
                        seen.add((first, second))
                        yield first, second
