"""Reading the history of nightly gaps: a file that is only ever replaced as a whole."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import duckdb

from s2rstore.errors import RequestError, first_line
from s2rstore.files import input_files, layout, safe_files
from s2rstore.files.plain_paths import plain_path
from s2rstore.files.store_files import Stamp
from s2rstore.gap_history import schema
from s2rstore.index import locked_connection
from s2rstore.intervals import Interval
from s2rstore.security.printable_text import printable_values

_MEMORY = "64MB"
Row = dict[str, Any]


@dataclass(frozen=True, slots=True)
class AxisFigures:
    """One row of table `axis`; unknown figures are NaN."""

    axis: str
    state: str
    measure: str | None
    unit: str | None
    value: Interval
    floor: Interval
    gap: Interval
    anchor: float
    n: int | None
    note: str | None


@dataclass(frozen=True, slots=True)
class NightlyEstimate:
    """A parameter of the simulator as identified."""

    parameter: str
    value: Interval
    unit: str
    note: str | None = None


@dataclass(frozen=True, slots=True)
class Night:
    """One row of `night` with the figures that it shares; unknown figures are NaN or None."""

    id: int
    name: str
    night: datetime.date
    key: str
    evidence: str
    measured: int
    dataset: str
    dataset_hash: str
    run: str
    run_key: str
    model: str | None
    expression: str
    outcome: str
    exit_code: int
    headline: str
    gap: Interval
    worst: str | None
    threshold: float
    reason: str
    change: str | None
    change_reason: str | None
    golden: str | None
    golden_change: Interval
    golden_margin: float
    evidence_since: datetime.date
    evidence_age: int
    stale_after: float
    written_at: str
    axes: tuple[AxisFigures, ...] = ()
    estimates: tuple[NightlyEstimate, ...] = ()

    @property
    def stale(self) -> bool:
        """Whether the newest evidence is too old."""
        return self.evidence_age > self.stale_after

    @property
    def refused(self) -> bool:
        """Whether nothing could be measured; `reason` says why."""
        return not self.axes


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """All rows of a history, by night and order of writing; equal only to itself.

    `recorded` is the first night that used a part of the evidence, by configuration and part;
    `last_id` is the largest id that was ever used, withdrawn nights included.
    """

    nights: tuple[Night, ...] = ()
    recorded: Mapping[tuple[str, str], datetime.date] = field(default_factory=dict)
    last_id: int = 0

    def of_configuration(self, name: str) -> tuple[Night, ...]:
        """The nights of one configuration; the last record of each counts."""
        return tuple({n.night: n for n in self.nights if n.name == name}.values())

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
    """Everything but the reports. Raises RequestError for a file that is missing or no history."""
    with _opened(path) as connection:
        names = [table.name for table in schema.TABLES]
        rows = {name: _rows(connection, name) for name in names if name != "report"}
    used = [*rows["night"], *rows[schema.WITHDRAWN.name]]
    last_id = max((row["id"] for row in used), default=0)
    axes = _grouped(rows["axis"], _axis)
    estimates = _grouped(rows["estimate"], _estimate)
    nights = []
    for row in rows["night"]:
        figures = {name: Interval.from_columns(row, name) for name in ("gap", "golden_change")}
        columns = {column for name, each in figures.items() for column in each.as_columns(name)}
        plain = {name: value for name, value in row.items() if name not in columns}
        for name in ("threshold", "golden_margin", "stale_after"):
            plain[name] = _number(row[name])
        measured = row["measured"]
        nights.append(
            Night(axes=axes.get(measured, ()), estimates=estimates.get(measured, ()),
                  **(plain | figures))
        )  # fmt: skip
    recorded: dict[tuple[str, str], datetime.date] = {}
    for row in rows["recorded"]:
        recorded.setdefault((row["name"], row["part"]), row["night"])
    return History(tuple(nights), recorded, last_id)


def report_text(path: Path, measured: int) -> str:
    """The JSON of one measurement's report."""
    with _opened(path) as connection:
        query = "SELECT report FROM history.report WHERE measured = ?"
        row = connection.execute(query, [measured]).fetchone()
    if row is None:
        raise RequestError(f"{path}: holds no report of measurement {measured}; restore it")
    return str(row[0])


def check(path: Path) -> None:
    """Read everything, reports included, which holds every block against its checksum.

    Raises RequestError for a file that is missing, damaged or no history.
    """
    read(path)
    with _opened(path) as connection:
        connection.execute("SELECT measured, report, version FROM history.report").fetchall()


@contextmanager
def _opened(path: Path) -> Iterator[duckdb.DuckDBPyConnection]:
    """A connection that can reach no other file, with the file attached as `history`.

    Each call attaches the file to a new database: DuckDB would give a second connection to one path
    the content that the first one read.
    """
    refuse_link(path)
    path = path.resolve()
    if not path.is_file():
        raise RequestError(f"{path}: no history; `s2r nightly CONFIG.toml` writes one")
    connection = locked_connection.connect_empty(
        [plain_path(path.parent, path.name).parent], _MEMORY
    )
    try:
        locked_connection.attach_read_only(connection, path, "history", schema.TABLES, schema.VIEWS)
        yield connection
    except duckdb.Error as error:
        message = f"{path}: no history that this version reads ({first_line(error)})"
        raise RequestError(message) from error
    finally:
        connection.close()


def _rows(connection: duckdb.DuckDBPyConnection, table: str) -> list[Row]:
    """The rows of a table, with texts in printable characters."""
    known = next(each for each in schema.TABLES if each.name == table)
    names = ", ".join(f'"{name}"' for name in known.column_names)
    query = f'SELECT {names} FROM history."{table}" ORDER BY {", ".join(known.order)}'
    rows = connection.execute(query).fetchall()
    return [printable_values(dict(zip(known.column_names, row, strict=True))) for row in rows]


def _grouped(rows: Sequence[Row], parse: Any) -> dict[int, tuple[Any, ...]]:
    grouped: dict[int, list[Any]] = {}
    for row in rows:
        grouped.setdefault(row["measured"], []).append(parse(row))
    return {measured: tuple(parts) for measured, parts in grouped.items()}


def _axis(row: Row) -> AxisFigures:
    value, floor, gap = (Interval.from_columns(row, name) for name in ("value", "floor", "gap"))
    return AxisFigures(
        row["axis"], row["state"], row["measure"], row["unit"], value, floor, gap,
        _number(row["anchor"]), row["n"], row["note"],
    )  # fmt: skip


def _estimate(row: Row) -> NightlyEstimate:
    value = Interval.from_columns(row, "value")
    return NightlyEstimate(row["parameter"], value, row["unit"] or "", row["note"])


def _number(value: float | None) -> float:
    return float("nan") if value is None else float(value)
