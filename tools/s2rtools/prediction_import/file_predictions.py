"""The predictions of one file: rows matched with instances, poses in metres and radians."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.records import MAX_COORDINATE, SIDES, SPLITS, Side
from s2rtools.common.input_issue import InputIssue, issue_lines
from s2rtools.motion_logs.pose_readers import yaw
from s2rtools.precompute.prediction_rows import UNSEEN
from s2rtools.prediction_import import instance_matching, pose_units
from s2rtools.prediction_import.instance_matching import NONE, UNKNOWN, ImportTarget, Matches
from s2rtools.prediction_import.pose_units import AUTO, Units
from s2rtools.prediction_import.prediction_table import PredictionTable, sigmas_of

MAX_HEADING = 1e6
"""Largest heading that is read, radians."""
_LENGTH_TOLERANCE = 0.05
"""Difference of a quaternion's length from 1 that is rounding."""
_QUATERNION = ("qx", "qy", "qz", "qw")
_HEADINGS = ("heading", "heading_deg", "heading_rad")
_REQUIRED = "x, y and heading (or heading_deg, heading_rad, or qx, qy, qz and qw)"

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ReadingOptions:
    """How the numbers of a file are read.

    `heading` is a convention of `pose_units` or `AUTO`; `tolerance` is in seconds.
    """

    units: Units = field(default_factory=Units)
    heading: str = "0+h"
    tolerance: float = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class FilePredictions:
    """Usable predictions of a file: at most one for each instance and side.

    One without a pose, which the other program did not localise, has NaN in `poses`.

    `iids`, `sides` (indexes into `SIDES`), `rows` of the table and `splits` (indexes into
    `SPLITS`), each (n,); `poses` (n, 3): x, y in metres, heading in radians on the map; `sigmas`
    (n,) in metres, NaN where the file states none.
    `without_numbers` says of a side how many of its predictions have no number, and where.
    `row_sides` are those of all rows, None where a row has both. `facts` describe how the file was
    read, `summary` in one line.
    """

    table: PredictionTable
    iids: NDArray[np.int64]
    sides: NDArray[np.int8]
    rows: NDArray[np.int64]
    poses: Floats
    sigmas: Floats
    splits: NDArray[np.int8]
    row_sides: NDArray[np.int8] | None
    without_numbers: dict[Side, str]
    facts: dict[str, Any]
    summary: str
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Entries:
    """Predictions as the file has them, one or two for each row.

    `rows`, `sides` and `iids` (n,), the latter `NONE` where unknown; `numbers` (n, 3): x, y and
    heading, which comes from the columns `heading_from`.
    """

    rows: NDArray[np.int64]
    sides: NDArray[np.int8]
    iids: NDArray[np.int64]
    numbers: Floats
    heading_from: str
    splits: NDArray[np.int8]

    def chosen(self, entries: NDArray[Any]) -> _Entries:
        return _Entries(self.rows[entries], self.sides[entries], self.iids[entries],
                        self.numbers[entries], self.heading_from, self.splits[entries])  # fmt: skip

    @property
    def localised(self) -> _Entries:
        """The entries with a pose."""
        return self.chosen(_is_whole(self.numbers))


def read_predictions(
    table: PredictionTable,
    side: Side | None,
    target: ImportTarget,
    options: ReadingOptions,
    trajectory: str | None = None,
) -> FilePredictions:
    """Match the rows of a table and bring their poses into the map.

    `side` is that of all rows, None where the table tells it, and so is `trajectory`. Rows that
    cannot be used are added to the issues of the table. Raises RequestError where columns are
    missing or nothing fits.
    """
    is_wide = side is None and instance_matching.has_both_sides(table)
    count, sides = len(table), None
    if not is_wide:
        sides = instance_matching.row_sides(table, side, target)
    named, matches, sides_found = instance_matching.match_rows(
        table, np.zeros(count, dtype=np.int8) if sides is None else sides, target,
        options.tolerance, pose_units.TIMES[options.units.time], trajectory,
    )  # fmt: skip
    row_sides = None if is_wide else sides_found
    found = _entries(table, matches, row_sides)
    without_numbers = _without_numbers(table, found, is_wide)
    entries = _usable(table, found, is_wide)
    length, angle = _units(table, entries.localised, options.units, target)
    scale = np.array([length.scale, length.scale, angle.scale])
    entries = _first_of_each(table, _in_range(table, entries, entries.numbers * scale))
    poses, localised = entries.numbers * scale, entries.localised
    convention, error, warnings = _convention(table, localised, angle, target, options)
    poses[:, 2] = pose_units.to_map(poses[:, 2], convention)
    warnings += pose_units.length_warnings(
        localised.numbers[:, :2], length.name, _truth(localised, target)[:, :2],
        target.store.dataset.bounds, str(table.path),
    )  # fmt: skip
    sigmas = sigmas_of(table, entries.rows, entries.sides, is_wide, length.scale)
    sigmas[~_is_whole(entries.numbers)] = np.nan
    with_sigma = np.isfinite(sigmas)
    lost = len(entries.iids) - len(localised.iids)
    if matches.offsets is not None:
        named += f" (largest difference {np.nanmax(matches.offsets):.2g} s)"
    facts = {
        "file": table.path.name,
        "columns": list(table.columns),
        "rows": count,
        "matched_by": named,
        "used": len(entries.iids),
        "without_pose": lost,
        "with_sigma": int(with_sigma.sum()),
        "not_used": dict(Counter(issue.kind for issue in table.issues)),
        "length": length.name,
        "angle": angle.name,
        "heading": convention,
    }
    summary = (
        f"{table.path.name}: {len(entries.iids)} predictions in {count} rows, "
        f"{f'{lost} of them without a pose, ' if lost else ''}matched by {named}; "
        f"positions in {length}, headings in {angle}, map heading {convention}; median error "
        f"{_median_errors(entries, poses, target)}, heading {math.degrees(error):.3g} deg"
    )
    if with_sigma.any():
        median = np.median(sigmas[with_sigma])
        summary += f"; {with_sigma.sum()} with a sigma, median {median:.3g} m"
    return FilePredictions(
        table, entries.iids, entries.sides, entries.rows, poses, sigmas, entries.splits, row_sides,
        without_numbers, facts, summary, warnings,
    )  # fmt: skip


def _convention(
    table: PredictionTable,
    entries: _Entries,
    unit: pose_units.Unit,
    target: ImportTarget,
    options: ReadingOptions,
) -> tuple[str, float, tuple[str, ...]]:
    """The convention of the headings of `entries`, its median error, and warnings about it."""
    truth, where = _truth(entries, target)[:, 2], str(table.path)
    errors = pose_units.heading_errors(entries.numbers[:, 2] * unit.scale, truth)
    convention = options.heading
    if convention == AUTO:
        convention = pose_units.best_convention(errors, len(truth), where)
    warnings = pose_units.convention_warnings(
        entries.numbers[:, 2], unit.name, convention, truth, where
    )
    return convention, errors[convention], warnings


def _truth(entries: _Entries, target: ImportTarget) -> Floats:
    """The true poses (n, 3) of the images that were predicted, each that of its side."""
    poses = np.stack([target.store.poses(target.domains[side]) for side in SIDES])
    return np.asarray(poses[entries.sides, entries.iids])


def _median_errors(entries: _Entries, poses: Floats, target: ImportTarget) -> str:
    """The median distance of the known `poses` (n, 3) to the ground truth on each side."""
    off = np.hypot(*(poses - _truth(entries, target))[:, :2].T)
    known = [off[(entries.sides == code) & np.isfinite(off)] for code in range(len(SIDES))]
    return ", ".join(
        f"{side} {np.median(errors):.3g} m"
        for side, errors in zip(SIDES, known, strict=True)
        if errors.size
    )


def _entries(
    table: PredictionTable, matches: Matches, row_sides: NDArray[np.int8] | None
) -> _Entries:
    """All predictions of a table; two for each row where `row_sides` is None."""
    rows = np.arange(len(table))
    if row_sides is not None:
        numbers, heading_from = _pose_numbers(table)
        splits = _splits(table, "split")
        return _Entries(rows, row_sides, matches.iids, numbers, heading_from, splits)
    (sim, heading_from), (real, other) = (_columns(table, f"{side}_") for side in SIDES)
    if heading_from != other:
        raise RequestError(f"{table.path}: sim and real headings differ in unit; name both alike")
    sides = np.repeat(np.array([0, 1], dtype=np.int8), len(table))
    splits = np.concatenate([_splits(table, f"{side}_split") for side in SIDES])
    numbers = np.concatenate([sim, real])
    return _Entries(
        np.tile(rows, 2), sides, np.tile(matches.iids, 2), numbers, heading_from, splits
    )


def _pose_numbers(table: PredictionTable) -> tuple[Floats, str]:
    """x, y and heading of each row (n, 3), and the columns that the heading comes from."""
    numbers = table.numbers
    if any(name in numbers for name in _HEADINGS):
        return _columns(table, "")
    if not {*_QUATERNION, "x", "y"} <= set(numbers):
        raise _missing(table)
    return np.column_stack([numbers["x"], numbers["y"], _yaw(table)]), "quaternion"


def _columns(table: PredictionTable, prefix: str) -> tuple[Floats, str]:
    numbers = table.numbers
    headings = [name for name in _HEADINGS if prefix + name in numbers]
    if len(headings) > 1:
        listed = " and ".join(prefix + name for name in headings)
        raise RequestError(f"{table.path}: has {listed}; remove one")
    names = [f"{prefix}x", f"{prefix}y", *(prefix + name for name in headings)]
    if not headings or any(name not in numbers for name in names):
        raise _missing(table)
    return np.column_stack([numbers[name] for name in names]), headings[0]


def _missing(table: PredictionTable) -> RequestError:
    return RequestError(f"{table.path}: needs columns {_REQUIRED}; has {table.found_text}")


def _yaw(table: PredictionTable) -> Floats:
    """Yaw of the quaternions (n,), NaN where they are not normalised."""
    quaternions = np.column_stack([table.numbers[name] for name in _QUATERNION])
    length = np.linalg.norm(quaternions, axis=1)
    is_unit = np.abs(length - 1) <= _LENGTH_TOLERANCE
    odd = np.flatnonzero(np.isfinite(length) & ~is_unit).tolist()
    table.report("quaternion not normalised", odd, lambda row: f"length {length[row]:.4g}")
    heading, rows = np.full(len(length), np.nan), np.flatnonzero(is_unit)
    heading[rows] = yaw(quaternions[rows], table.place)
    return heading


def _splits(table: PredictionTable, column: str) -> NDArray[np.int8]:
    """Index into `SPLITS` of each row; `unseen` where the file does not say."""
    if column not in table.texts:
        return np.full(len(table), UNSEEN, dtype=np.int8)
    known: dict[str, int] = {"": UNSEEN}
    known |= {name: code for code, name in enumerate(SPLITS)}
    values = table.texts[column]
    for row, value in enumerate(values):
        if value not in known:
            allowed = ", ".join(SPLITS)
            raise RequestError(f"{table.path}: {table.place(row)}: {column} {value!r}: one of "
                               f"{allowed}")  # fmt: skip
    return np.array([known[value] for value in values], dtype=np.int8)


def _number_columns(entries: _Entries, entry: int, is_wide: bool) -> list[str]:
    """The columns of an entry that hold no number."""
    heading = (
        ", ".join(_QUATERNION) if entries.heading_from == "quaternion" else entries.heading_from
    )
    names = ("x", "y", heading)
    prefix = f"{SIDES[entries.sides[entry]]}_" if is_wide else ""
    is_finite = np.isfinite(entries.numbers[entry])
    return [prefix + name for name, known in zip(names, is_finite, strict=True) if not known]


def _without_numbers(table: PredictionTable, entries: _Entries, is_wide: bool) -> dict[Side, str]:
    """How many predictions of a side have no number, in which columns, and the first one."""
    found: dict[Side, str] = {}
    is_finite = _is_whole(entries.numbers)
    for code, side in enumerate(SIDES):
        of_side = (entries.iids != NONE) & (entries.sides == code)
        bad = np.flatnonzero(of_side & ~is_finite).tolist()
        if bad:
            columns = dict.fromkeys(
                name for entry in bad for name in _number_columns(entries, entry, is_wide)
            )
            first = table.place(int(entries.rows[bad[0]]))
            found[side] = (
                f"{len(bad)} of its {int(of_side.sum())} rows in {table.path.name} have no number "
                f"(columns {', '.join(columns)}; the first is {first})"
            )
    return found


def _is_whole(numbers: Floats) -> NDArray[np.bool_]:
    """(n,) whether all numbers of a pose are known."""
    return np.asarray(np.isfinite(numbers).all(axis=1))


def _usable(table: PredictionTable, entries: _Entries, is_wide: bool) -> _Entries:
    """The entries with instance and side; those without a whole pose become NaN.

    A pose of which a part alone is missing is reported. Raises RequestError where none is whole.
    """
    is_named = (entries.iids != NONE) & (entries.sides != UNKNOWN)
    known, is_whole = np.isfinite(entries.numbers), _is_whole(entries.numbers)
    table.issues.extend(
        InputIssue(
            "incomplete pose, not localised",
            _place(table, entries, k),
            f"no number in {', '.join(_number_columns(entries, k, is_wide))}",
        )
        for k in np.flatnonzero(is_named & ~is_whole & known.any(axis=1)).tolist()
    )
    if not (is_named & is_whole).any():
        raise _unusable(table, _without_numbers(table, entries, is_wide))
    numbers = np.where(is_whole[:, None], entries.numbers, np.nan)
    return replace(entries, numbers=numbers).chosen(is_named)


def _unusable(table: PredictionTable, without: Mapping[Side, str] | None = None) -> RequestError:
    lines = [f"{side}: {text}" for side, text in (without or {}).items()] or issue_lines(
        table.issues
    )
    reasons = "; ".join(" ".join(text.split()) for text in lines[:2])
    return RequestError(f"{table.path}: no row can be used ({reasons})")


def _units(
    table: PredictionTable, entries: _Entries, units: Units, target: ImportTarget
) -> tuple[pose_units.Unit, pose_units.Unit]:
    """The units of positions and headings: declared by option or column, or recognised."""
    where, bounds = str(table.path), target.store.dataset.bounds
    length = pose_units.length_unit(units.length, entries.numbers[:, :2], bounds, where)
    known = {"heading_deg": "deg", "heading_rad": "rad", "quaternion": "rad"}
    declared = known.get(entries.heading_from, units.angle)
    if units.angle not in (None, declared):
        raise RequestError(
            f"{where}: --units {units.angle}: headings are in {declared} ({entries.heading_from})"
        )
    return length, pose_units.angle_unit(declared, entries.numbers[:, 2], where)


def _in_range(table: PredictionTable, entries: _Entries, poses: Floats) -> _Entries:
    """The entries whose `poses`, metres and radians, are plausible; reports the others.

    Raises RequestError where there is none.
    """
    is_far = (np.abs(poses[:, :2]) > MAX_COORDINATE).any(axis=1)
    is_far |= np.abs(poses[:, 2]) > MAX_HEADING
    limits = f"beyond {MAX_COORDINATE:g} m or {MAX_HEADING:g} rad"
    table.issues.extend(
        InputIssue("out of range", _place(table, entries, k), limits)
        for k in np.flatnonzero(is_far).tolist()
    )
    if is_far.all():
        raise _unusable(table)
    return entries.chosen(~is_far)


def _first_of_each(table: PredictionTable, entries: _Entries) -> _Entries:
    """The first entry of each instance and side; reports the others."""
    first, repeated = instance_matching.first_of_each(2 * entries.iids + entries.sides)
    table.issues.extend(
        InputIssue(
            "duplicate row",
            _place(table, entries, k),
            f"repeats instance {entries.iids[k]} of {_place(table, entries, used)}, which is used",
        )
        for k, used in repeated.items()
    )
    return entries.chosen(first)


def _place(table: PredictionTable, entries: _Entries, entry: int) -> str:
    """Where an entry is, such as `predictions.csv:12 (real)`."""
    return f"{table.place(int(entries.rows[entry]))} ({SIDES[entries.sides[entry]]})"
