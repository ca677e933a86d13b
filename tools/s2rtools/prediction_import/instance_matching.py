"""Match the rows of a table with the instances of a store, by the columns that the table has."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtools.prediction_import.prediction_table import PredictionTable

NONE = -1
"""Stands for no instance."""
UNKNOWN = -1
"""Stands for no side."""


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


@dataclass(frozen=True, slots=True)
class ImportTarget:
    """The instances that rows are matched with: those of a store, imaged in one domain per side."""

    store: Store
    domains: dict[Side, str]

    def trajectory_codes(
        self, table: PredictionTable, trajectory: str | None
    ) -> NDArray[np.int32] | None:
        """Index of the trajectory of each row, -1 for unknown ones; None where none is named.

        `trajectory` is that of all rows. Raises RequestError if it is not in the store.
        """
        codes = {name: code for code, name in enumerate(self.store.instances.trajectory_names)}
        if trajectory is not None:
            if trajectory not in codes:
                known = ", ".join(codes)
                raise RequestError(f"{table.path}: no trajectory {trajectory!r} (has: {known})")
            return np.full(len(table), codes[trajectory], dtype=np.int32)
        if "trajectory" not in table.texts:
            return None
        return np.array([codes.get(name, -1) for name in table.texts["trajectory"]], dtype=np.int32)


def has_both_sides(table: PredictionTable) -> bool:
    """Whether a row has the predictions of both sides, in columns sim_x, real_x and so on."""
    return {f"{side}_{axis}" for side in SIDES for axis in "xy"} <= set(table.numbers)


def row_sides(table: PredictionTable, side: Side | None, target: ImportTarget) -> NDArray[np.int8]:
    """Index into `SIDES` for each row, `UNKNOWN` where it cannot be told; these are reported.

    `side` is that of all rows, None where columns or images tell it. Raises RequestError where
    nothing tells it.
    """
    count = len(table)
    if side is not None:
        return np.full(count, SIDES.index(side), dtype=np.int8)
    column, codes = "side", {str(name): code for code, name in enumerate(SIDES)}
    if column not in table.texts:
        column = "domain"
        codes = {target.domains[name]: code for code, name in enumerate(SIDES)}
    if column not in table.texts:
        if "image" in table.texts and "iid" not in table.numbers:
            return np.full(count, UNKNOWN, dtype=np.int8)  # `match_rows` finds it by the image
        raise RequestError(
            f"{table.path}: sim or real? add a column side or domain, or name the file by "
            f"--predictions sim:{table.path.name} or real:{table.path.name} (has: "
            f"{table.found_text})"
        )
    values = table.texts[column]
    sides = np.array([codes.get(text, UNKNOWN) for text in values], dtype=np.int8)
    listed = " or ".join(codes)
    table.report(
        f"row of another {column}",
        np.flatnonzero(sides == UNKNOWN).tolist(),
        lambda row: f"{column} {values[row]!r}, not {listed}",
    )
    return sides


def match_rows(
    table: PredictionTable, sides: NDArray[np.int8], target: ImportTarget, tolerance: float,
    seconds: float, trajectory: str | None = None,
) -> tuple[str, Matches, NDArray[np.int8]]:  # fmt: skip
    """What rows are matched by, their instances and their sides; rows without one are reported.

    `tolerance` is in seconds, `seconds` are those of a unit of time in the table, `trajectory` that
    of all rows, None where the table tells it. Where no column
    tells the side of a row, its image does. Raises RequestError where no column names instances.
    """
    numbers, texts, store = table.numbers, table.texts, target.store
    codes = target.trajectory_codes(table, trajectory)
    is_known = sides != UNKNOWN
    if "iid" in numbers:
        named, found = "iid", match_iids(numbers["iid"], len(store.instances))
    elif "image" in texts:
        is_known |= "side" not in texts and "domain" not in texts
        named, (found, sides) = "image", _match_images(table, sides, target)
    elif "seq" in numbers and (trajectory is not None or "trajectory" in texts):
        names = list(texts["trajectory"]) if trajectory is None else [trajectory] * len(table)
        query = "SELECT trajectory, seq, iid FROM instance"
        known = {(str(name), int(seq)): int(iid) for name, seq, iid in store.execute(query)}
        named = "trajectory and seq"
        found = match_positions(names, numbers["seq"], known)
    elif "timestamp" in numbers:
        named = f"time within {tolerance:g} s"
        found = _match_times(table, sides, target, tolerance, seconds, codes)
    else:
        raise RequestError(
            f"{table.path}: which instances? add a column iid, image or timestamp, or the columns "
            f"trajectory and seq (has: {table.found_text})"
        )
    if trajectory is not None and named in ("iid", "image"):
        raise RequestError(f"{table.path}: rows are matched by {named}; do not name a trajectory")
    unmatched = sorted(row for row in found.reasons if is_known[row])
    table.report("unmatched row", unmatched, lambda row: found.reasons[row])
    return named, found, sides


def _match_images(
    table: PredictionTable, sides: NDArray[np.int8], target: ImportTarget
) -> tuple[Matches, NDArray[np.int8]]:
    """The instances of images; `UNKNOWN` sides become that of the domain that has the image."""
    query = "SELECT iid, rgb_path FROM frame WHERE domain = ? AND rgb_path IS NOT NULL"
    indexes = [ImageIndex(target.store.execute(query, [target.domains[side]])) for side in SIDES]
    if not any(map(len, indexes)):
        raise RequestError(f"{target.store.path}: has no paths of images; match rows by iid")
    has_side = "side" in table.texts or "domain" in table.texts
    iids, reasons = np.full(len(table), NONE, dtype=np.int64), dict[int, str]()
    found_sides = sides.copy()
    for row, path in enumerate(table.texts["image"]):
        side = int(sides[row])
        searched = () if side == UNKNOWN and has_side else (0, 1) if side == UNKNOWN else (side,)
        found = [(code, *match_image(path, indexes[code])) for code in searched]
        hits = [(code, iid) for code, iid, _ in found if iid != NONE]
        if len(hits) == 1:
            found_sides[row], iids[row] = hits[0]
        elif hits:
            reasons[row] = f"image {path!r} is in both domains; add a column side"
        elif found:
            reasons[row] = found[0][2]
    return Matches(iids, reasons), found_sides


def _match_times(
    table: PredictionTable,
    sides: NDArray[np.int8],
    target: ImportTarget,
    tolerance: float,
    seconds: float,
    requested: NDArray[np.int32] | None,
) -> Matches:
    """The instances nearest in time, for the rows of each side apart.

    `requested` are the trajectories of rows, if they are known.
    """
    truth = target.store.instances
    if not np.isfinite(truth.timestamp).any():
        raise RequestError(f"{target.store.path}: instances have no times; match rows by iid")
    times = table.numbers["timestamp"] * seconds
    iids = np.full(len(table), NONE, dtype=np.int64)
    offsets, reasons = np.full(len(table), np.nan), dict[int, str]()
    for code in np.unique(sides):
        rows = np.flatnonzero(sides == code)
        found = match_times(
            times[rows], truth.timestamp, truth.trajectory, tolerance,
            None if requested is None else requested[rows],
        )  # fmt: skip
        iids[rows], offsets[rows] = found.iids, found.offsets
        reasons |= {int(rows[row]): reason for row, reason in found.reasons.items()}
    return Matches(iids, reasons, offsets)
