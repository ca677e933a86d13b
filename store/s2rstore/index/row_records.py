"""Make records of the rows of an index, and refuse rows that no store has.

An index can have been edited by hand, or crafted to do harm: numbers may be NULL, NaN or absurdly
large, JSON may not parse, names may be paths. The types of the records' fields state what a single
value may be; what depends on several values is checked here. The small tables are read when a store
is opened.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, TypeVar

import msgspec
from msgspec import Meta

from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.files.documents import parse_json
from s2rstore.records import (
    HASH,
    MAX_COORDINATE,
    MAX_LABEL,
    NAME,
    RECALL_THRESHOLDS,
    SIDES,
    ArrayRecord,
    Bounds,
    Dataset,
    Domain,
    Intrinsics,
    Label,
    Model,
    Part,
    Room,
    Run,
    Trajectory,
    TranslatorRecord,
)
from s2rstore.security.printable_text import printable_values

Row = dict[str, Any]
T = TypeVar("T")

MAX_THRESHOLDS = 8
THRESHOLDS_ARE = (
    f"not 1 to {MAX_THRESHOLDS} pairs [metres, degrees] in ascending order, from 0.001 to "
    f"{MAX_COORDINATE:g} m and 180 degrees"
)
"""What is wrong with thresholds of recall that are refused."""
MAX_JSON = 100_000
MAX_ROWS = {"trajectory": 100_000, "room": 4_096, "label": MAX_LABEL, "domain": 1_024,
            "model": 10_000, "run": 10_000, "translator": 10_000, "part": 100_000}  # fmt: skip
"""Rows that a table which is read whole may have."""
TRANSLATE = "translate"
"""Adjustment by a translator T; its name in a chain is `translate:T`."""
_EDGES = ("x0", "y0", "x1", "y1")
_LENS = ("fx", "fy", "cx", "cy", "pitch")
CAMERA_COLUMNS = (
    *(f"rgb_{name}" for name in _LENS), *(f"depth_{name}" for name in _LENS),
    "camera_height", "forward_offset", "depth_scale", "depth_raw_min", "depth_raw_max",
)  # fmt: skip
"""Columns of table `domain` that are NULL in a data set without poses."""
DEPTH_COLUMNS = tuple(name for name in CAMERA_COLUMNS if name.startswith("depth_"))
"""Columns of table `domain` that are NULL in a domain without depth."""
_MAP_COLUMNS = (*(f"bounds_{edge}" for edge in _EDGES), "accuracy_scale")
_NAN_LENS = Intrinsics(math.nan, math.nan, math.nan, math.nan, math.nan)
_PLACE = re.compile(
    r"(?P<reason>.*?)(?: matching regex '(?P<pattern>.*?)')?(?: - at `\$\.?(?P<column>.*)`)?\Z"
)
_FORMS = {
    HASH: "not 16 to 64 hexadecimal digits",
    NAME: "not a name of letters, digits, dots, hyphens and underscores",
}
"""What a text is that a pattern refuses."""

_Number = Annotated[float, Meta(ge=-1e9, le=1e9)]
_Two = Annotated[list[_Number], Meta(min_length=2, max_length=2)]
_Three = Annotated[list[_Number], Meta(min_length=3, max_length=3)]


class _Input(msgspec.Struct):
    """The values of an input contract that readers rely on."""

    channels: Literal["rgb", "depth", "rgbd"]
    rgb_interpolation: str
    depth_interpolation: str
    colour_order: str
    size: _Two
    mean: _Three
    std: _Three
    depth_range: _Two
    rgb_scale: _Number
    depth_unit: _Number
    depth_mean: _Number
    depth_std: _Number
    missing_depth: _Number | None = None


class RowReader:
    """Makes records of one table's rows; a RequestError names the file, the row and the column.

    `label` is the column that names a row in messages.
    """

    def __init__(self, index: Path, table: str, label: str = "") -> None:
        self._index, self._table, self._label = index, table, label

    def refuse(self, row: Row, column: str, reason: str) -> NoReturn:
        of = f" of {row[self._label]!r}" if self._label else ""
        where = f"{self._index}: table {self._table}: {column}{of}"
        raise RequestError(f"{where}: {reason}; run `s2r verify`")

    def record(self, row: Row, kind: type[T], column: str = "") -> T:
        """A row, or the object in its `column`, as a record, whose types it must have."""
        try:
            return msgspec.convert(row[column] if column else row, kind)
        except msgspec.ValidationError as error:
            place = _PLACE.match(str(error))
            assert place is not None
            found, pattern = (place["column"] or "").replace(".", "_"), place["pattern"]
            reason = place["reason"]
            if pattern is not None:
                reason = _FORMS.get(
                    pattern.replace("\\\\", "\\"), "not in the form that this column needs"
                )
            self.refuse(row, column or found, f"{found}: {reason}" if column and found else reason)

    def records(self, rows: Iterable[Row], kind: type[T], unique: str) -> list[T]:
        """Convert all rows to records; refuse a value that column `unique` holds twice."""
        found, values = [], set()
        for row in rows:
            found.append(self.record(row, kind))
            if row[unique] in values:
                self.refuse(row, unique, "is a duplicate")
            values.add(row[unique])
        return found

    def require_null(self, row: Row, columns: Iterable[str], where: str) -> None:
        for column in columns:
            if row[column] is not None:
                self.refuse(row, column, f"{row[column]} in {where}")

    def parsed(self, row: Row, column: str) -> Any:
        """The JSON value of a column; its texts are printable, and its numbers finite."""
        text = row[column]
        if not isinstance(text, str) or len(text) > MAX_JSON:
            self.refuse(row, column, "not a JSON text")
        value = parse_json(text, f"{self._index}: table {self._table}: {column}")
        try:
            json.dumps(value, allow_nan=False)
        except (ValueError, RecursionError):
            self.refuse(row, column, "a number that is not finite")
        return printable_values(value)


def dataset(index: Path, row: Row) -> Dataset:
    reader = RowReader(index, "dataset")
    has_poses, stored = row["has_poses"] is not False, row["recall_thresholds"]
    thresholds = RECALL_THRESHOLDS if stored is None else reader.parsed(row, "recall_thresholds")
    row = row | {"has_poses": has_poses, "recall_thresholds": thresholds}
    if not has_poses:
        where = "a data set without poses"
        reader.require_null(row, ("floor_plan", *_MAP_COLUMNS), where)
        if stored is not None:
            reader.refuse(row, "recall_thresholds", f"thresholds in {where}")
        row |= dict.fromkeys(_MAP_COLUMNS, 1.0)
    bounds = {edge: row[f"bounds_{edge}"] for edge in _EDGES}
    found = reader.record(row | {"bounds": bounds}, Dataset)
    if not are_thresholds(found.recall_thresholds):
        reader.refuse(row, "recall_thresholds", THRESHOLDS_ARE)
    if not has_poses:
        nowhere = Bounds(math.nan, math.nan, math.nan, math.nan)
        return replace(found, bounds=nowhere, accuracy_scale=math.nan)
    if not (found.bounds.width > 0 and found.bounds.height > 0):
        reader.refuse(row, "bounds", "x1 and y1 must be larger than x0 and y0")
    return found


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


def trajectories(index: Path, rows: Sequence[Row]) -> list[Trajectory]:
    return RowReader(index, "trajectory", "trajectory").records(rows, Trajectory, "trajectory")


def rooms(index: Path, rows: Sequence[Row]) -> list[Room]:
    """`position` decides which of two rooms a point belongs to, so it must be unique."""
    reader = RowReader(index, "room", "room")
    found = reader.records(rows, Room, "position")
    for room, row in zip(found, rows, strict=True):
        if room.x1 < room.x0 or room.y1 < room.y0:
            reader.refuse(row, "x1", "x1 and y1 must not be smaller than x0 and y0")
    return found


def labels(index: Path, rows: Sequence[Row]) -> list[Label]:
    return RowReader(index, "label", "name").records(rows, Label, "label")


def domains(index: Path, rows: Sequence[Row], has_poses: bool = True) -> list[Domain]:
    """The domains; figures that one without depth or without poses lacks are NaN."""
    reader = RowReader(index, "domain", "domain")
    found, changes = [], []
    for row in rows:
        if row["hash"] is not None:
            layout.checked_hash(row["hash"], f"{index}: table domain: hash")
        has_depth = has_poses and row["has_depth"] is not False
        missing: list[str] = []
        if not has_poses:
            missing += CAMERA_COLUMNS
            reader.require_null(row, missing, "a data set without poses")
        elif not has_depth:
            missing += DEPTH_COLUMNS
            reader.require_null(row, missing, "a domain without depth")
            missing += ["camera_height"] if row["camera_height"] is None else []
        changes.append(_without_figures(missing, has_depth))
        row = row | dict.fromkeys(missing, 1)
        lenses = {
            image: {name: row[f"{image}_{name}"] for name in _LENS} for image in ("rgb", "depth")
        }
        sources = reader.parsed(row, "source") if row["source"] else {}
        found.append(row | lenses | {"sources": sources, "has_depth": has_depth})
    records = reader.records(found, Domain, "domain")
    return [replace(domain, **each) for domain, each in zip(records, changes, strict=True)]


def _without_figures(missing: Sequence[str], has_depth: bool) -> dict[str, Any]:
    """The fields of a domain that stand for `missing` columns."""
    changes: dict[str, Any] = {
        name: math.nan
        for name in ("camera_height", "forward_offset", "depth_scale") if name in missing
    }  # fmt: skip
    if "rgb_fx" in missing:
        changes["rgb"] = _NAN_LENS
    if not has_depth:
        changes |= {"depth": _NAN_LENS, "depth_raw_min": 1, "depth_raw_max": 0}
    return changes


def parts(index: Path, rows: Sequence[Row], instances: int) -> list[Part]:
    """Parts follow one another without gaps and hold all instances."""
    reader = RowReader(index, "part", "part")
    found, stop = reader.records(rows, Part, "part"), 0
    for number, (part, row) in enumerate(zip(found, rows, strict=True)):
        if (part.part, part.first_iid) != (number, stop) or not part.instances:
            reader.refuse(row, "first_iid", f"not part {number} from instance {stop} on")
        stop = part.stop
    if found and stop != instances:
        raise RequestError(
            f"{index}: table part: {stop} instances, table instance: {instances}; run `s2r verify`"
        )
    return found


def models(index: Path, rows: Sequence[Row]) -> list[Model]:
    reader = RowReader(index, "model", "model")
    found = [row | {"input": reader.parsed(row, "input")} for row in rows]
    for row in found:
        reader.record(row, _Input, "input")
        if not isinstance(reader.parsed(row, "convention"), dict):
            reader.refuse(row, "convention", "not a JSON object")
    return reader.records(found, Model, "model")


def translators(index: Path, rows: Sequence[Row]) -> list[TranslatorRecord]:
    reader = RowReader(index, "translator", "translator")
    found = [
        row | {"reasons": reader.parsed(row, "reasons") if row["reasons"] else []} for row in rows
    ]
    return reader.records(found, TranslatorRecord, "translator")


def runs(index: Path, rows: Sequence[Row]) -> list[Run]:
    """The adjustments of a run are `{"name", "value"}`; translations name their file."""
    reader = RowReader(index, "run", "run")
    chains = [f"{side}_adjustments" for side in SIDES]
    parsed = [row | {chain: reader.parsed(row, chain) for chain in chains} for row in rows]
    found = reader.records(parsed, Run, "run")
    for run, row in zip(found, rows, strict=True):
        for chain in chains:
            for step in getattr(run, chain):
                if not isinstance(step.get("name"), str):
                    reader.refuse(row, chain, 'not a list of {"name", "value"}')
                if step["name"].partition(":")[0] == TRANSLATE:
                    layout.checked_hash(step.get("sha256"), f"{index}: table run: {chain}")
    return found


def arrays(index: Path, rows: Sequence[Row]) -> list[ArrayRecord]:
    reader = RowReader(index, "zarr_array", "path")
    found = []
    for row in rows:
        facts = {column: reader.parsed(row, column) for column in ("shape", "axes")}
        record = reader.record(row | facts | {"first_iid": row["first_iid"] or 0}, ArrayRecord)
        if len(record.axes) != len(record.shape):
            reader.refuse(row, "axes", f"{row['axes']} does not name the axes of {row['shape']}")
        found.append(record)
    return found
