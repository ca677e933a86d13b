"""The history of nightly gaps: a file of JSON lines, one record per measured night.

`read_json` of DuckDB reads it. A record holds the fields of `Night`, of which a figure `gap` is
`gap`, `gap_low`, `gap_high` and `gap_reason`; unknown values are null. The record of a new
measurement holds its report, too, as JSON text. The file is only ever replaced as a whole.
"""

from __future__ import annotations

import datetime
import json
import math
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import msgspec

from s2rstore.errors import RequestError, first_line
from s2rstore.files import input_files, layout, safe_files
from s2rstore.files.store_files import Stamp
from s2rstore.gap_history.gate_status import EXIT_CODES_TEXT
from s2rstore.intervals import LEVEL_TEXT, Interval
from s2rstore.security.printable_text import printable_values

MAX_BYTES = 1 << 30
"""Bytes of a history: more than a night of 100 kB on every day of 25 years."""
BOUNDS = {"": "", "_low": f", lower {LEVEL_TEXT} bound", "_high": f", upper {LEVEL_TEXT} bound"}
"""Suffixes of the numbers of a figure and its interval, and of their comments."""
_CHECKSUM = b', "crc32": '
"""Precedes the last value of a line: the checksum of what stands before it."""
_UNKNOWN = Interval.unknown()
_MAX_INTEGER = 2**53
_MALFORMED = (msgspec.MsgspecError, TypeError, ValueError, AttributeError, KeyError, RecursionError)
"""What decoding and converting a record of unknown origin raises."""
Row = dict[str, Any]
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class AxisFigures:
    """One axis of the gap in one night; unknown figures are NaN."""

    axis: Annotated[str, "name"]
    state: Annotated[str, "measured, absent (no evidence) or inconclusive (too little)"]
    measure: Annotated[str | None, "what the value is; null = not measured"] = None
    unit: Annotated[str | None, "of value, floor and anchor; null = not measured"] = None
    value: Annotated[Interval, "the measure"] = _UNKNOWN
    floor: Annotated[Interval, "what it would be without a gap"] = _UNKNOWN
    gap: Annotated[Interval, "G = 100 (value - floor) / (anchor - floor)"] = _UNKNOWN
    anchor: Annotated[float, "what it is in the declared bad state; null = not judged"] = math.nan
    n: Annotated[int | None, "samples"] = None
    note: Annotated[str | None, "warnings, or why it was not measured"] = None


@dataclass(frozen=True, slots=True)
class NightlyEstimate:
    """A parameter of the simulator as identified from drives, or what its images are worth."""

    parameter: Annotated[str, "name"]
    value: Annotated[Interval, "estimate"]
    unit: Annotated[str, "of the estimate"] = ""
    note: Annotated[str | None, "warnings, as on identifiability"] = None


@dataclass(frozen=True, slots=True)
class Night:
    """One record of the history; unknown figures are NaN or None."""

    id: Annotated[int, "order of writing, from 1; the last record of a night is the valid one"]
    name: Annotated[str, "of the nightly configuration"]
    night: Annotated[datetime.date, "UTC date"]
    key: Annotated[str, "SHA-256 of all that the figures depend on"]
    evidence: Annotated[str, "SHA-256 of what was recorded: data set, run, drives"]
    measured: Annotated[int, "id of the night whose figures these are"]
    dataset: Annotated[str, "name of the environment"]
    dataset_hash: Annotated[str, "of the store's data set"]
    run: Annotated[str, "run of the store"]
    run_key: Annotated[str, "hash of all that its predictions depend on"]
    model: Annotated[str | None, "the run's model; null = its predictions were imported"]
    expression: Annotated[str, "which instances were selected"]
    outcome: Annotated[
        str,
        "PASS, FAIL or INCONCLUSIVE: headline, golden run, growth and age of the evidence, with a "
        "budget of false alarms for a year; ERROR = the request does not fit what is there",
    ]
    exit_code: Annotated[int, EXIT_CODES_TEXT]
    headline: Annotated[str, "PASS, FAIL or INCONCLUSIVE: the worst axis"]
    gap: Annotated[Interval, "G of the worst axis; 0 = no gap, 100 = the declared bad state"]
    worst: Annotated[str | None, "the worst axis; null = none was judged"]
    threshold: Annotated[float, "of G"]
    reason: Annotated[str, "of the headline, or why nothing was measured"]
    change: Annotated[
        str | None, "PASS, FAIL or INCONCLUSIVE: growth of G over the nights; null = none"
    ]
    change_reason: Annotated[str | None, "of the growth, by axis"]
    golden: Annotated[str | None, "PASS, FAIL or INCONCLUSIVE; null = no golden run"]
    golden_change: Annotated[Interval, "mean real error against the golden run, m"]
    golden_margin: Annotated[float, "by which it may have grown, m"]
    evidence_since: Annotated[datetime.date, "first night that saw the newest part of the evidence"]
    evidence_age: Annotated[int, "days from then to this night"]
    stale_after: Annotated[float, "days from which on evidence is too old"]
    written_at: Annotated[str, "UTC, ISO 8601"]
    axes: Annotated[
        tuple[AxisFigures, ...], "axes of the gap; none where nothing was measured"
    ] = ()
    estimates: Annotated[tuple[NightlyEstimate, ...], "estimates of the simulator"] = ()
    parts: Annotated[
        tuple[str, ...], "parts of the evidence: hashes of the data set, the run and every log"
    ] = ()
    version: Annotated[str, "of the program"] = ""
    withdrawn_at: Annotated[
        str | None, "UTC, ISO 8601; readers leave out nights that were taken back; null = valid"
    ] = None

    @property
    def stale(self) -> bool:
        """Whether the newest evidence is too old."""
        return self.evidence_age > self.stale_after

    @property
    def refused(self) -> bool:
        """Whether nothing could be measured; `reason` says why."""
        return not self.axes


_HINTS: dict[type, dict[str, Any]] = {
    kind: get_type_hints(kind, include_extras=True)
    for kind in (AxisFigures, NightlyEstimate, Night)
}
"""Type and meaning of every field of a record."""


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """The nights of a history by night and order of writing; equal only to itself.

    `last_id` is the largest id that was ever used, withdrawn nights included.
    """

    nights: tuple[Night, ...] = ()
    last_id: int = 0

    def of_configuration(self, name: str) -> tuple[Night, ...]:
        """The nights of one configuration; the last record of each counts."""
        return tuple({n.night: n for n in self.nights if n.name == name}.values())

    def first_nights(self, name: str) -> dict[str, datetime.date]:
        """The first night of a configuration that used each part of the evidence.

        Records count that a later one of the same night replaced.
        """
        mine = [night for night in self.nights if night.name == name]
        return {part: night.night for night in reversed(mine) for part in night.parts}

    def of_run(self, run: str, dataset: str) -> tuple[Night, ...]:
        """The nights of a run, from the configuration that ran last.

        A data set is identified by its name: recordings of another day have another hash.
        """
        mine = [n for n in self.nights if (n.run, n.dataset) == (run, dataset)]
        if not mine:
            return ()
        name = max(mine, key=lambda night: (night.night, night.id)).name
        return tuple(night for night in self.of_configuration(name) if night in mine)

    def runs(self, dataset: str) -> tuple[str, ...]:
        """The runs of a data set that have nights."""
        runs = (n.run for n in self.nights if n.dataset == dataset)
        return tuple(dict.fromkeys(runs))


def history_path(store: Path) -> Path:
    """The path of the history inside a store."""
    return store / layout.GAP_HISTORY


def refuse_link(path: Path) -> None:
    """Raise RequestError where the history inside a store is a link, a folder or a device.

    A history elsewhere belongs to the user, who may link it.
    """
    store = path.parent.parent
    if path == history_path(store) and safe_files.kind(store, layout.CURRENT) is not None:
        safe_files.checked_path(store, path.relative_to(store))


def file_stamp(path: Path) -> Stamp | None:
    """A value that changes when the file is replaced; None where it is missing."""
    return input_files.stamp(path)


def read(path: Path) -> History:
    """All nights that were not withdrawn, without their reports.

    Raises RequestError for a file that is missing, damaged or no history.
    """
    nights = [_record(Night, row, f"{path}: line {line}") for line, row in _rows(path)]
    valid = sorted((n for n in nights if not n.withdrawn_at), key=lambda n: (n.night, n.id))
    return History(tuple(valid), max(night.id for night in nights))


def report_text(path: Path, measured: int) -> str:
    """The JSON of one measurement's report."""
    for number, line in enumerate(lines(path), start=1):
        try:
            row = msgspec.json.decode(line, type=dict[str, msgspec.Raw])
            if "report" in row and msgspec.json.decode(row["id"]) == measured:
                return msgspec.json.decode(row["report"], type=str)
        except _MALFORMED as error:
            raise _invalid(f"{path}: line {number}", error) from error
    raise RequestError(f"{path}: holds no report of measurement {measured}; restore it")


def lines(path: Path) -> list[bytes]:
    """The lines of a file, whose checksums agree. Raises RequestError."""
    refuse_link(path)
    if not path.resolve().is_file():
        raise RequestError(f"{path}: no history; `s2r nightly CONFIG.toml` writes one")
    content = input_files.read_bytes(path.resolve(), MAX_BYTES)
    found = content.splitlines(keepends=True)
    for number, line in enumerate(found, start=1):
        before, mark, checksum = line.rpartition(_CHECKSUM)
        if not mark or checksum != b"%d}\n" % zlib.crc32(before):
            raise RequestError(
                f"{path}: no history that this version reads (line {number} is damaged)"
            )
    if not found:
        raise RequestError(f"{path}: no history that this version reads (empty)")
    return found


def line_of(night: Night, report: str | None = None) -> bytes:
    """The line of a night; `report` is the JSON text of its measurement."""
    row = _as_row(night) | ({} if report is None else {"report": report})
    return checked_line(json.dumps(row, allow_nan=False).encode())


def checked_line(row: bytes) -> bytes:
    """The line of a JSON object, with its checksum as its last value."""
    before = row.rstrip().removesuffix(b"}")
    return before + _CHECKSUM + b"%d}\n" % zlib.crc32(before)


def record_fields(kind: type) -> Iterator[tuple[str, str, str]]:
    """Names, types in DuckDB and meanings of the fields of a record, for the reference."""
    for name, hint in _HINTS[kind].items():
        plain, meaning = get_args(hint)[:2]
        if plain is Interval:
            yield from (
                (f"{name}{end}", "DOUBLE", f"{meaning}{text}") for end, text in BOUNDS.items()
            )
            yield f"{name}_reason", "VARCHAR", f"{meaning}, why a bound is null"
        else:
            yield name, _sql_type(plain), meaning


def _sql_type(plain: Any) -> str:
    names = {int: "BIGINT", float: "DOUBLE", str: "VARCHAR", datetime.date: "DATE"}
    of = get_args(plain)
    if get_origin(plain) is tuple:
        return f"{names.get(of[0], 'STRUCT')}[]"
    return names[of[0] if of else plain]


def _rows(path: Path) -> Iterator[tuple[int, Row]]:
    """Number and values of each line but its report, with texts in printable characters."""
    for number, line in enumerate(lines(path), start=1):
        try:
            raw = msgspec.json.decode(line, type=dict[str, msgspec.Raw])
            row = {key: msgspec.json.decode(raw[key]) for key in raw if key != "report"}
        except _MALFORMED as error:
            raise _invalid(f"{path}: line {number}", error) from error
        yield number, printable_values(row)


def _record(kind: type[T], row: Row, where: str) -> T:
    """A record from the values of a line."""
    values = {}
    for name, hint in _HINTS[kind].items():
        try:
            values[name] = _value(get_args(hint)[0], row, name, where)
        except _MALFORMED as error:
            raise _invalid(f"{where}: {name}", error) from error
    return kind(**values)


def _value(plain: Any, row: Row, name: str, where: str) -> Any:
    if plain is Interval:
        return Interval.from_columns(row, name)
    if plain is float:
        return math.nan if row[name] is None else msgspec.convert(row[name], float)
    if get_origin(plain) is tuple and get_args(plain)[0] is not str:
        return tuple(_record(get_args(plain)[0], each, where) for each in row[name])
    value = msgspec.convert(row.get(name), plain)
    if isinstance(value, int) and abs(value) > _MAX_INTEGER:
        raise ValueError("too large")
    return value


def _as_row(record: Any) -> Row:
    """The values of a record as JSON data."""
    row: Row = {}
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, Interval):
            row |= value.as_columns(field.name)
        elif isinstance(value, tuple):
            row[field.name] = [each if isinstance(each, str) else _as_row(each) for each in value]
        elif isinstance(value, float) and not math.isfinite(value):
            row[field.name] = None
        else:
            row[field.name] = str(value) if isinstance(value, datetime.date) else value
    return row


def _invalid(where: str, error: Exception) -> RequestError:
    return RequestError(f"{where}: no history that this version reads ({first_line(error)})")
