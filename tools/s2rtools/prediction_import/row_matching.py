"""Find the instance of each row: by iid, image, trajectory and seq, or time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

NONE = -1
"""Stands for no instance."""


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """`iids` (n,) of n rows, `NONE` where there is none, and the reasons by row.

    `offsets` (n,) are the distances in seconds where rows were matched by time, NaN for others.
    """

    iids: NDArray[np.int64]
    reasons: dict[int, str] = field(default_factory=dict)
    offsets: NDArray[np.float64] | None = None


def match_iids(values: NDArray[np.float64], count: int) -> Matches:
    """Rows that name iids, in a store of `count` instances."""
    whole = np.isfinite(values) & (values == np.floor(values))
    known = whole & (values >= 0) & (values < count)
    iids = np.where(known, values, NONE).astype(np.int64)
    reasons = {
        int(row): f"iid {values[row]:.12g}: the store holds 0 .. {count - 1}"
        if whole[row]
        else "iid is no whole number"
        for row in np.flatnonzero(~known)
    }
    return Matches(iids, reasons)


def match_positions(
    trajectories: Sequence[str], seqs: NDArray[np.float64], known: dict[tuple[str, int], int]
) -> Matches:
    """Rows that name a trajectory and a seq; `known` gives the iids of these."""
    iids, reasons = np.full(len(seqs), NONE, dtype=np.int64), {}
    for row, (name, seq) in enumerate(zip(trajectories, seqs.tolist(), strict=True)):
        found = known.get((name, int(seq))) if np.isfinite(seq) and seq == int(seq) else None
        if found is None:
            reasons[row] = f"no instance with trajectory {name!r} and seq {seq:.12g}"
        else:
            iids[row] = found
    return Matches(iids, reasons)


class ImageIndex:
    """The images of a domain by their paths, as table `frame` has them.

    A given path stands for an image if one of both is the end of the other, in whole parts:
    `0001.png` and `/data/set/rgb/0001.png` stand for `rgb/0001.png`, `depth/0001.png` does not.
    """

    def __init__(self, images: Sequence[tuple[int, str]]) -> None:
        """`images` are iids with the paths of their RGB images."""
        self._by_name: dict[str, list[tuple[int, tuple[str, ...]]]] = defaultdict(list)
        for iid, path in images:
            parts = _parts(path)
            if parts:
                self._by_name[parts[-1]].append((iid, parts))

    def __len__(self) -> int:
        return sum(map(len, self._by_name.values()))

    def find(self, path: str) -> list[int]:
        """The iids of the images that a path stands for; exactly that path first of all."""
        given = _parts(path)
        if not given:
            return []
        candidates = self._by_name.get(given[-1], [])
        exact = [iid for iid, parts in candidates if parts == given]
        return exact or [iid for iid, parts in candidates if _is_end(given, parts)]


def _parts(path: str) -> tuple[str, ...]:
    parts = PurePosixPath(path.replace("\\", "/")).parts
    return tuple(part for part in parts if part not in ("/", "."))


def _is_end(a: tuple[str, ...], b: tuple[str, ...]) -> bool:
    shorter = min(len(a), len(b))
    return a[-shorter:] == b[-shorter:]


def match_image(path: str, index: ImageIndex) -> tuple[int, str]:
    """The iid of an image, or `NONE` and the reason."""
    found = index.find(path)
    if len(found) == 1:
        return found[0], ""
    if not found:
        return NONE, f"image {path!r} is not in the store"
    return NONE, f"image {path!r} stands for {len(found)} images; give more of its path"


def match_times(
    times: NDArray[np.float64],
    stamps: NDArray[np.float64],
    trajectories: NDArray[np.int32],
    tolerance: float,
    requested: NDArray[np.int32] | None = None,
) -> Matches:
    """The instance nearest in time to each row, if it is at most `tolerance` seconds away.

    `stamps` and `trajectories` (N,) are those of the instances; `requested` (n,) the trajectories
    that rows name, -1 for unknown ones. Without these a row within the tolerance of instances of
    several trajectories has no match. Of several rows nearest to one instance the nearest counts,
    the first of equally near ones.
    """
    iids = np.full(len(times), NONE, dtype=np.int64)
    offsets, reasons = np.full(len(times), np.nan), dict[int, str]()
    groups = [(np.arange(len(times)), np.flatnonzero(np.isfinite(stamps)))]
    if requested is not None:
        groups = [
            (
                np.flatnonzero(requested == code),
                np.flatnonzero((trajectories == code) & np.isfinite(stamps)),
            )
            for code in np.unique(requested)
        ]
    for rows, instances in groups:
        order = instances[np.argsort(stamps[instances], kind="stable")]
        found, distance, is_ambiguous = _nearest(
            times[rows], stamps[order], trajectories[order], tolerance
        )
        near = (distance <= tolerance) & ~is_ambiguous
        iids[rows[near]], offsets[rows[near]] = order[found[near]], distance[near]
        for row, away, unclear in zip(rows.tolist(), distance.tolist(), is_ambiguous, strict=True):
            if unclear:
                reasons[row] = "its time fits several trajectories; name that of the row or file"
            elif not away <= tolerance:
                reasons[row] = f"the nearest instance is {away:.6g} s away"
                if not np.isfinite(away):
                    reasons[row] = "no instance to compare its time with"
    _keep_nearest(iids, offsets, reasons)
    return Matches(iids, reasons, offsets)


def _nearest(
    times: NDArray[np.float64],
    stamps: NDArray[np.float64],
    trajectories: NDArray[np.int32],
    tolerance: float,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.bool_]]:
    """Position and distance of the nearest of ascending `stamps`, and whether several fit.

    Several fit where stamps of more than one trajectory are within the tolerance.
    """
    if not stamps.size:
        nothing = np.zeros(len(times), dtype=np.int64)
        return nothing, np.full(len(times), np.inf), np.zeros(len(times), dtype=np.bool_)
    after = np.searchsorted(stamps, times).clip(0, stamps.size - 1)
    before = (after - 1).clip(0)
    to_before, to_after = np.abs(times - stamps[before]), np.abs(times - stamps[after])
    found = np.where(to_before <= to_after, before, after)
    distance = np.where(np.isfinite(times), np.minimum(to_before, to_after), np.inf)
    changes = np.cumsum(np.diff(trajectories, prepend=trajectories[0]) != 0)
    first = np.searchsorted(stamps, times - tolerance).clip(0, stamps.size - 1)
    last = (np.searchsorted(stamps, times + tolerance, side="right") - 1).clip(0)
    several = (distance <= tolerance) & (changes[last] != changes[first])
    return found, distance, several


def _keep_nearest(
    iids: NDArray[np.int64], offsets: NDArray[np.float64], reasons: dict[int, str]
) -> None:
    """Leave each instance to the nearest of its rows."""
    rows = np.flatnonzero(iids != NONE)
    order = rows[np.lexsort((rows, offsets[rows], iids[rows]))]
    repeated = np.zeros(order.size, dtype=np.bool_)
    repeated[1:] = iids[order[1:]] == iids[order[:-1]]
    for row in order[repeated].tolist():
        reasons[row] = f"another row is nearer to instance {iids[row]}"
        iids[row], offsets[row] = NONE, np.nan


def first_of_each(keys: NDArray[Any]) -> tuple[NDArray[np.int64], dict[int, int]]:
    """The first row of each key, ascending, and for each repeated row the first row of its key."""
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    repeated = np.ones(len(keys), dtype=np.bool_)
    repeated[first] = False
    return np.sort(first), {int(row): int(first[inverse[row]]) for row in np.flatnonzero(repeated)}
