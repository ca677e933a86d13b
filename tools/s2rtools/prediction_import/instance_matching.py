"""Match the rows of a table with the instances of a store, by the columns that the table has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtools.prediction_import import row_matching
from s2rtools.prediction_import.prediction_table import PredictionTable
from s2rtools.prediction_import.row_matching import NONE, ImageIndex, Matches

UNKNOWN = -1
"""Stands for no side."""


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
        named, found = "iid", row_matching.match_iids(numbers["iid"], len(store.instances))
    elif "image" in texts:
        is_known |= "side" not in texts and "domain" not in texts
        named, (found, sides) = "image", _match_images(table, sides, target)
    elif "seq" in numbers and (trajectory is not None or "trajectory" in texts):
        names = list(texts["trajectory"]) if trajectory is None else [trajectory] * len(table)
        query = "SELECT trajectory, seq, iid FROM instance"
        known = {(str(name), int(seq)): int(iid) for name, seq, iid in store.execute(query)}
        named = "trajectory and seq"
        found = row_matching.match_positions(names, numbers["seq"], known)
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
        found = [(code, *row_matching.match_image(path, indexes[code])) for code in searched]
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
        found = row_matching.match_times(
            times[rows], truth.timestamp, truth.trajectory, tolerance,
            None if requested is None else requested[rows],
        )  # fmt: skip
        iids[rows], offsets[rows] = found.iids, found.offsets
        reasons |= {int(rows[row]): reason for row, reason in found.reasons.items()}
    return Matches(iids, reasons, offsets)
