"""Check the rows of an index before anything relies on them.

An index can have been edited by hand, or crafted to do harm: numbers may be NULL, NaN or absurdly
large, JSON may not parse, names may be paths. The checks run when a store is opened.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NoReturn

from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.input_files import parse_json
from s2rstore.records import DIRECTIONS, SIDES
from s2rstore.security.printable_text import printable_values

Row = dict[str, Any]

MAX_COORDINATE = 1e6
"""Metres from the origin that bounds and rooms may reach."""
MAX_IMAGE_SIZE = 16_384
"""Rows or columns of a stored frame, or of the input of a model."""
MAX_INPUT_NUMBER = 1e9
"""Numbers of an input contract: units, ranges, means."""
MAX_THRESHOLDS = 8
THRESHOLDS_ARE = (
    f"not 1 to {MAX_THRESHOLDS} pairs [metres, degrees] in ascending order, from 0.001 to "
    f"{MAX_COORDINATE:g} m and 180 degrees"
)
"""What is wrong with thresholds of recall that are refused."""
MAX_LABEL = 65_535
"""Largest value of a pixel of a label image."""
MAX_TEXT = 1_000
MAX_JSON = 100_000
MAX_ROWS = {"trajectory": 100_000, "room": 4_096, "label": MAX_LABEL, "domain": 1_024,
            "model": 10_000, "run": 10_000, "translator": 10_000, "part": 100_000}  # fmt: skip
"""Rows that a table which is read whole may have."""
CHANNELS = ("rgb", "depth", "rgbd")
"""What the input of a network may hold."""
TRANSLATE = "translate"
"""Adjustment by a translator T; its name in a chain is `translate:T`."""
_DTYPES = frozenset({"uint8", "uint16", "int8", "int16", "int32", "float16", "float32", "float64"})
_KIND = re.compile(r"[a-z][a-z0-9_:]{0,79}\Z")
_EDGES = ("x0", "y0", "x1", "y1")
_INTRINSICS = ("fx", "fy", "cx", "cy", "pitch")
CAMERA_COLUMNS = (
    *(f"rgb_{name}" for name in _INTRINSICS), *(f"depth_{name}" for name in _INTRINSICS),
    "camera_height", "forward_offset", "depth_scale", "depth_raw_min", "depth_raw_max",
)  # fmt: skip
"""Columns of table `domain` that are NULL in a data set without poses."""
DEPTH_COLUMNS = tuple(name for name in CAMERA_COLUMNS if name.startswith("depth_"))
"""Columns of table `domain` that are NULL in a domain without depth."""


class RowChecker:
    """Checks one row; a RequestError names the file, the table, the row and the column."""

    def __init__(self, index: Path, table: str, row: Row, label: object = "") -> None:
        self._index = index
        self._table = table
        self._row = row
        self._label = f" of {label!r}" if label else ""

    def refuse(self, column: str, reason: str) -> NoReturn:
        where = f"table {self._table}: {column}{self._label}"
        raise RequestError(f"{self._index}: {where}: {reason}; run `s2r verify`")

    def number(self, column: str, low: float, high: float) -> float:
        """A finite number in [low, high]."""
        value = self._row[column]
        if not isinstance(value, int | float) or not low <= value <= high:
            self.refuse(column, f"{value} is not a number from {low:g} to {high:g}")
        return value

    def numbers(self, low: float, high: float, *columns: str) -> None:
        for column in columns:
            self.number(column, low, high)

    def has(self, column: str) -> bool:
        """Whether a column is not NULL."""
        return self._row[column] is not None

    def text(self, column: str, optional: bool = False, longest: int = MAX_TEXT) -> None:
        value = self._row[column]
        if value is None and optional:
            return
        if not isinstance(value, str) or not value or len(value) > longest:
            self.refuse(column, f"not a text of 1 to {longest} characters")

    def name(self, column: str) -> None:
        """A name that folders of the store are called by."""
        self.text(column)
        try:
            layout.checked_name(self._row[column], column)
        except RequestError as error:
            raise RequestError(f"{self._index}: {error}") from error

    def nulls(self, *columns: str, where: str = "a data set without poses") -> None:
        """Columns that must be empty in `where`."""
        for column in columns:
            if self._row[column] is not None:
                self.refuse(column, f"{self._row[column]} in {where}")

    def choice(self, column: str, allowed: Sequence[str | bool | None]) -> None:
        if self._row[column] not in allowed:
            self.refuse(
                column, f"{self._row[column]!r} is not one of {', '.join(map(str, allowed))}"
            )

    def parsed(self, column: str, kind: type) -> Any:
        """The JSON value of a column, which must be of this type; its texts are printable."""
        text = self._row[column]
        if not isinstance(text, str) or len(text) > MAX_JSON:
            self.refuse(column, "not a JSON text")
        value = parse_json(text, f"{self._index}: table {self._table}: {column}{self._label}")
        if not isinstance(value, kind):
            self.refuse(column, f"not a JSON {'list' if kind is list else 'object'}")
        return printable_values(value)


def _checkers(
    index: Path, table: str, rows: Sequence[Row], label: str, unique: str | None = None
) -> Iterator[tuple[Row, RowChecker]]:
    """Each row with its checker, labelled by a column; refuses duplicates in column `unique`."""
    values = set()
    for row in rows:
        yield row, RowChecker(index, table, row, row[label])
        if unique is None:
            continue
        if row[unique] in values:
            where = f"{index}: table {table}: {unique} {row[unique]!r}"
            raise RequestError(f"{where} is a duplicate; run `s2r verify`")
        values.add(row[unique])


def check_dataset(index: Path, row: Row) -> None:
    check = RowChecker(index, "dataset", row)
    check.text("name")
    check.text("floor_plan", optional=True)
    layout.checked_hash(row["hash"], f"{index}: table dataset: hash")
    check.choice("y_down", (True, False))
    check.numbers(1, MAX_IMAGE_SIZE, "frame_height", "frame_width")
    check.choice("has_poses", (True, False, None))
    if row["has_poses"] is False:
        edges = (f"bounds_{edge}" for edge in _EDGES)
        check.nulls("floor_plan", *edges, "accuracy_scale", "recall_thresholds")
        return
    x0, y0, x1, y1 = (
        check.number(f"bounds_{edge}", -MAX_COORDINATE, MAX_COORDINATE) for edge in _EDGES
    )
    if not (x1 > x0 and y1 > y0):
        check.refuse("bounds", "x1 and y1 must be larger than x0 and y0")
    check.number("accuracy_scale", 1e-6, 2 * MAX_COORDINATE)
    if check.has("recall_thresholds") and not are_thresholds(
        check.parsed("recall_thresholds", list)
    ):
        check.refuse("recall_thresholds", THRESHOLDS_ARE)


def are_thresholds(pairs: Sequence[Any]) -> bool:
    """Whether `pairs` of metres and degrees are what `THRESHOLDS_ARE` says."""
    if not 1 <= len(pairs) <= MAX_THRESHOLDS or not all(map(_is_threshold, pairs)):
        return False
    metres, degrees = zip(*pairs, strict=True)
    return len(set(metres)) == len(pairs) and all(
        list(column) == sorted(column) for column in (metres, degrees)
    )


def _is_threshold(pair: Any) -> bool:
    return (
        isinstance(pair, list | tuple)
        and len(pair) == 2
        and all(type(limit) in (int, float) for limit in pair)
        and 1e-3 <= pair[0] <= MAX_COORDINATE
        and 1e-3 <= pair[1] <= 180
    )


def check_trajectories(index: Path, rows: Sequence[Row]) -> None:
    for _, check in _checkers(index, "trajectory", rows, "trajectory", "trajectory"):
        check.name("trajectory")
        check.text("recorded_at", optional=True)
        check.number("instances", 0, 2**31 - 1)


def check_rooms(index: Path, rows: Sequence[Row]) -> None:
    """`position` decides which of two rooms a point belongs to, so it must be unique."""
    for _, check in _checkers(index, "room", rows, "room", "position"):
        check.text("room")
        check.number("position", 0, 2**31 - 1)
        x0, y0, x1, y1 = (check.number(edge, -MAX_COORDINATE, MAX_COORDINATE) for edge in _EDGES)
        if x1 < x0 or y1 < y0:
            check.refuse("x1", "x1 and y1 must not be smaller than x0 and y0")


def check_labels(index: Path, rows: Sequence[Row]) -> None:
    for _, check in _checkers(index, "label", rows, "name", "label"):
        check.number("label", 1, MAX_LABEL)
        check.text("name")


def check_domains(index: Path, rows: Sequence[Row], has_poses: bool = True) -> list[Row]:
    """Rows with `source` as an object of texts. Without poses there are no cameras."""
    checked = []
    for row, check in _checkers(index, "domain", rows, "domain", "domain"):
        check.name("domain")
        check.choice("kind", SIDES)
        check.choice("has_depth", (True, False, None))
        if has_poses:
            _check_cameras(check, row["has_depth"] is not False)
        else:
            check.nulls(*CAMERA_COLUMNS)
        sources = check.parsed("source", dict) if row["source"] else {}
        if not all(isinstance(value, str) for value in sources.values()):
            check.refuse("source", "not an object of texts")
        if row["hash"] is not None:
            layout.checked_hash(row["hash"], f"{index}: table domain: hash of {row['domain']!r}")
        checked.append({**row, "source": sources})
    return checked


def _check_cameras(check: RowChecker, has_depth: bool) -> None:
    for image in ("rgb", "depth") if has_depth else ("rgb",):
        check.numbers(1e-6, 1e7, f"{image}_fx", f"{image}_fy")
        check.numbers(-1e7, 1e7, f"{image}_cx", f"{image}_cy")
        check.number(f"{image}_pitch", -math.pi, math.pi)
    check.number("forward_offset", -MAX_COORDINATE, MAX_COORDINATE)
    if has_depth or check.has("camera_height"):
        check.number("camera_height", -MAX_COORDINATE, MAX_COORDINATE)
    if not has_depth:
        check.nulls(*DEPTH_COLUMNS, where="a domain without depth")
        return
    check.number("depth_scale", 1e-12, 1e6)
    check.numbers(0, 2**31 - 1, "depth_raw_min", "depth_raw_max")


def check_parts(index: Path, rows: Sequence[Row], instances: int) -> None:
    """Parts follow one another without gaps and hold all instances."""
    first = 0
    for number, (row, check) in enumerate(_checkers(index, "part", rows, "part", "part")):
        check.number("part", number, number)
        check.number("first_iid", first, first)
        first += int(check.number("instances", 1, 2**31 - 1))
        layout.checked_hash(row["hash"], f"{index}: table part: hash of {number}")
        check.text("added_at", optional=True)
    if rows and first != instances:
        raise RequestError(
            f"{index}: table part: {first} instances, table instance: {instances}; run `s2r verify`"
        )


def check_models(index: Path, rows: Sequence[Row]) -> list[Row]:
    """Rows with `input` as an object."""
    checked = []
    for row, check in _checkers(index, "model", rows, "model", "model"):
        check.name("model")
        check.text("architecture")
        layout.checked_hash(row["sha256"], f"{index}: table model: sha256 of {row['model']!r}")
        check.numbers(1, MAX_IMAGE_SIZE, "input_height", "input_width")
        check.parsed("convention", dict)
        check.text("trained_by", optional=True, longest=MAX_JSON)
        contract = check.parsed("input", dict)
        _check_input(check, contract)
        checked.append({**row, "input": contract})
    return checked


def _check_input(check: RowChecker, contract: Row) -> None:
    """The values of an input contract have the types that readers rely on."""
    if contract.get("channels") not in CHANNELS:
        check.refuse("input", f"channels is not one of {', '.join(CHANNELS)}")
    for key in ("rgb_interpolation", "depth_interpolation", "colour_order"):
        if not isinstance(contract.get(key), str):
            check.refuse("input", f"{key} is not a text")
    for key, length in (("size", 2), ("mean", 3), ("std", 3), ("depth_range", 2)):
        values = contract.get(key)
        if (
            not isinstance(values, list)
            or len(values) != length
            or not all(map(_is_input_number, values))
        ):
            check.refuse("input", f"{key} is not a list of {length} numbers")
    for key in ("rgb_scale", "depth_unit", "depth_mean", "depth_std"):
        if not _is_input_number(contract.get(key)):
            check.refuse("input", f"{key} is not a number")
    missing = contract.get("missing_depth")
    if missing is not None and not _is_input_number(missing):
        check.refuse("input", "missing_depth is not a number")


def _is_input_number(value: Any) -> bool:
    """Whether a value of JSON is a number that an input contract may have."""
    return type(value) in (int, float) and abs(value) <= MAX_INPUT_NUMBER


def check_translators(index: Path, rows: Sequence[Row]) -> list[Row]:
    """Rows with `reasons` as a tuple of texts."""
    checked = []
    for row, check in _checkers(index, "translator", rows, "translator", "translator"):
        for column in ("translator", "method", "source_domain", "target_domain"):
            check.name(column)
        check.choice("direction", DIRECTIONS)
        where = f"{index}: table translator: sha256 of {row['translator']!r}"
        layout.checked_hash(row["sha256"], where)
        if row["accepted"] not in (True, False, None):
            check.refuse("accepted", "neither true nor false")
        reasons = check.parsed("reasons", list) if row["reasons"] else []
        if not all(isinstance(reason, str) for reason in reasons):
            check.refuse("reasons", "not a list of texts")
        check.text("created_at")
        checked.append({**row, "reasons": tuple(reasons)})
    return checked


def check_runs(index: Path, rows: Sequence[Row]) -> list[Row]:
    """Rows whose adjustments are lists of `{"name", "value"}`; translations name their file.

    Runs of imported predictions have no model.
    """
    checked = []
    for row, check in _checkers(index, "run", rows, "run", "run"):
        for column in ("run", "sim_domain", "real_domain"):
            check.name(column)
        if row["model"] is not None:
            check.name("model")
        adjustments = {}
        for side in SIDES:
            column = f"{side}_adjustments"
            adjustments[column] = check.parsed(column, list)
            for step in adjustments[column]:
                if not isinstance(step, dict) or not isinstance(step.get("name"), str):
                    check.refuse(column, 'not a list of {"name", "value"}')
                if step["name"].partition(":")[0] == TRANSLATE:
                    label = f"{index}: table run: {column} of {row['run']!r}"
                    layout.checked_hash(step.get("sha256"), label)
        if row["key"] is not None:
            check.name("key")
        check.text("precision", optional=True)
        check.text("created_at")
        checked.append({**row, **adjustments})
    return checked


def check_arrays(index: Path, rows: Sequence[Row]) -> list[Row]:
    """Rows with `shape` and `axes` as tuples."""
    checked = []
    for row, check in _checkers(index, "zarr_array", rows, "path"):
        check.text("path")
        for column in ("kind", "mode") if row["mode"] is not None else ("kind",):
            text = row[column]
            if not isinstance(text, str) or not _KIND.match(text):
                check.refuse(column, f"{text!r} does not name a kind or mode")
        check.choice("side", (*SIDES, None))
        check.choice("dtype", sorted(_DTYPES))
        shape, axes = check.parsed("shape", list), check.parsed("axes", list)
        if not all(type(size) is int and 0 <= size < 2**31 for size in shape):
            check.refuse("shape", f"{row['shape']} is not a list of sizes")
        if len(axes) != len(shape) or not all(isinstance(axis, str) for axis in axes):
            check.refuse("axes", f"{row['axes']} does not name the axes of {row['shape']}")
        check.numbers(-1e9, 1e9, "scale", "zero")
        layout.checked_hash(row["metadata_sha256"], f"{index}: table zarr_array: metadata_sha256")
        first_iid = row["first_iid"]
        if first_iid is not None:
            check.number("first_iid", 0, 2**31 - 1)
        checked.append(
            {**row, "shape": tuple(shape), "axes": tuple(axes), "first_iid": first_iid or 0}
        )
    return checked
