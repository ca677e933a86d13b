"""Write to the history: a copy is changed and replaces the file, so readers never see half."""

from __future__ import annotations

import datetime
import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import duckdb

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rstore.gap_history import reader, schema
from s2rstore.gap_history.gate_status import EXIT_CODES
from s2rstore.gap_history.reader import History, Night
from s2rstore.index import locked_connection
from s2rstore.index.schema import STORAGE_VERSION, Table
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.input_fingerprint import Inputs, version
from s2rtools.nightly.measurement import Estimates, Report
from s2rtools.nightly.report_model import outcome

Change = Callable[[duckdb.DuckDBPyConnection], None]
Rows = dict[str, list[dict[str, Any]]]
_FIGURES = ("value", "floor", "gap")
_SUFFIXES = ("", "_low", "_high")


@dataclass(frozen=True, slots=True)
class NightResult:
    """A night to be added; `measured` is the id of the measurement whose figures it reuses."""

    config: NightlyConfig
    inputs: Inputs
    night: datetime.date
    report: Report
    estimates: Estimates = ()
    measured: int | None = None


def read_or_empty(path: Path) -> History:
    """The history, empty where the file does not exist."""
    return reader.read(path) if path.exists() else History()


def counting_night(history: History, name: str, night: datetime.date) -> Night | None:
    """The row that counts for a night."""
    return next((each for each in history.of_configuration(name) if each.night == night), None)


def equal_measurement(history: History, key: str) -> int | None:
    """Id of the successful measurement with the same key, if there is one."""
    return next((n.measured for n in history.nights if n.key == key and not n.refused), None)


def is_recorded(night: Night | None, result: NightResult, history: History) -> bool:
    """Whether a row already holds the result."""
    if night is None or night.key != result.inputs.key:
        return False
    if night.evidence_since < max(_first_nights(result, history).values()):
        return False  # it was dated by a night that has been withdrawn
    refused = result.report.get("refused")
    if refused is None:
        return not night.refused
    return night.refused and (night.outcome, night.reason) == (
        refused["outcome"],
        refused["reason"],
    )


def rows(result: NightResult, history: History, now: datetime.datetime) -> Rows:
    """The rows that a result adds to each table."""
    number = history.last_id + 1
    measured = number if result.measured is None else result.measured
    first_nights = _first_nights(result, history)
    added: Rows = {
        "night": [_night_row(result, max(first_nights.values()), number, measured, now)],
        "recorded": [
            {"name": result.config.name, "part": part, "night": night}
            for part, night in first_nights.items()
            if history.recorded.get((result.config.name, part)) != night
        ],
    }
    if result.measured is None:
        report = json.dumps(result.report, indent=1, sort_keys=True, allow_nan=False)
        added["axis"] = [{"measured": number, **row} for row in _axis_rows(result.report)]
        added["estimate"] = [
            {"measured": number, "position": position, **row}
            for position, row in enumerate(result.estimates)
        ]
        added["report"] = [{"measured": number, "report": report, "version": version()}]
    return added


def _first_nights(result: NightResult, history: History) -> dict[str, datetime.date]:
    """The first night that used each part of the evidence."""
    name, night = result.config.name, result.night
    return {
        part: min(night, history.recorded.get((name, part), night)) for part in result.inputs.parts
    }


def _night_row(
    result: NightResult, since: datetime.date, number: int, measured: int, now: datetime.datetime
) -> dict[str, Any]:
    config, report, verdict = result.config, result.report, result.report["verdict"]
    golden = report["golden"] or {}
    age = (result.night - since).days
    final_outcome = outcome(report, age > config.stale_after)
    return {
        "id": number,
        "name": config.name,
        "night": result.night,
        "key": result.inputs.key,
        "evidence": result.inputs.evidence,
        "measured": measured,
        "dataset": report["dataset"]["name"],
        "dataset_hash": report["dataset"]["hash"],
        "run": report["run"],
        "run_key": report["run_key"],
        "model": report["model"],
        "expression": report["expression"],
        "outcome": final_outcome,
        "exit_code": EXIT_CODES[final_outcome],
        "headline": verdict["outcome"],
        **{f"gap{end}": verdict.get(f"gap{end}") for end in _SUFFIXES},
        "worst": verdict["worst"],
        "threshold": verdict["threshold"],
        "reason": verdict["reason"],
        "golden": golden.get("outcome"),
        **{f"golden_change{end}": golden.get(f"change{end}") for end in _SUFFIXES},
        "golden_margin": golden.get("margin"),
        "evidence_since": since,
        "evidence_age": age,
        "stale_after": config.stale_after,
        "written_at": now.astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
    }


def _axis_rows(report: Report) -> list[dict[str, Any]]:
    listed: list[dict[str, Any]] = []
    for each in report["axes"]:
        figures = {
            f"{name}{end}": each.get(f"{name}{end}") for name in _FIGURES for end in _SUFFIXES
        }
        note = "; ".join(each["notes"]) or None
        plain = {name: each.get(name) for name in ("axis", "measure", "unit", "anchor", "n")}
        listed.append({**plain, **figures, "state": "measured", "note": note})
    for state in ("inconclusive", "absent"):
        listed += [
            {"axis": name, "state": state, "note": why} for name, why in report[state].items()
        ]
    return [{"position": position, **row} for position, row in enumerate(listed)]


def append(path: Path, added: Rows) -> None:
    """Add rows durably, all or none; the caller holds the lock. Raises RequestError on failure."""
    _replace(path, partial(_add, added))


def withdraw_night(path: Path, name: str, night: datetime.date, now: str) -> None:
    """Move the rows of a night to the tables of withdrawn nights, all or none."""
    _replace(path, partial(_withdraw, name, night, now))


def _replace(path: Path, change: Change) -> None:
    reader.refuse_link(path)
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        for left in path.parent.glob(f".{path.name}.*.new*"):
            left.unlink(missing_ok=True)
        _write(beside, path if path.exists() else None, change)
        beside.chmod(0o644)
        atomic_writes.sync_path(beside)
        beside.replace(path)
        atomic_writes.sync_path(path.parent)
    except (OSError, duckdb.Error) as error:
        reason = str(error).splitlines()[0]
        raise RequestError(f"{path}: cannot be written ({reason})") from error
    finally:
        for name in (beside, beside.with_name(f"{beside.name}.wal")):
            with suppress(OSError):
                name.unlink(missing_ok=True)


def _write(path: Path, base: Path | None, change: Change) -> None:
    """Write a new file with the changed rows of `base`; its views are created again."""
    connection = locked_connection.connect_empty([path.absolute().parent])
    try:
        name = locked_connection.escaped(locked_connection.literal_path(path))
        connection.execute(f"ATTACH '{name}' AS history (STORAGE_VERSION '{STORAGE_VERSION}')")
        connection.execute("USE history")
        for statement in schema.statements():
            connection.execute(statement)
        if base is not None:
            locked_connection.attach_read_only(
                connection, base, "base", schema.TABLES, schema.VIEWS
            )
            for table in reader.tables_of(connection, "base"):
                names = ", ".join(f'"{column}"' for column in table.column_names)
                rows = f'SELECT {names} FROM base."{table.name}"'
                connection.execute(f'INSERT INTO history."{table.name}" ({names}) {rows}')
            connection.execute("DETACH base")
        change(connection)
        connection.execute("CHECKPOINT history")
        connection.execute("USE memory")
        connection.execute("DETACH history")
    finally:
        connection.close()


def _add(added: Rows, connection: duckdb.DuckDBPyConnection) -> None:
    for table, listed in added.items():
        for row in listed:
            _insert(connection, table, row)


def _withdraw(
    name: str, night: datetime.date, now: str, connection: duckdb.DuckDBPyConnection
) -> None:
    pairs: tuple[tuple[str, Table, dict[str, str]], ...] = (
        ("night", schema.WITHDRAWN, {"withdrawn_at": now}),
        ("recorded", schema.WITHDRAWN_RECORDED, {}),
    )
    for source, target, added in pairs:
        names = ", ".join(f'"{each}"' for each in target.column_names if each not in added)
        values = "".join(", ?" for _ in added)
        connection.execute(
            f"INSERT INTO {target.name} SELECT {names}{values} FROM {source} "
            "WHERE name = ? AND night = ?",
            [*added.values(), name, night],
        )
        connection.execute(f"DELETE FROM {source} WHERE name = ? AND night = ?", [name, night])


def _insert(connection: duckdb.DuckDBPyConnection, table: str, row: Mapping[str, Any]) -> None:
    names = ", ".join(f'"{name}"' for name in row)
    marks = ", ".join("?" for _ in row)
    values = [_finite_or_null(value) for value in row.values()]
    connection.execute(f'INSERT INTO "{table}" ({names}) VALUES ({marks})', values)


def _finite_or_null(value: Any) -> Any:
    """None (NULL) for numbers that are not finite."""
    if isinstance(value, float) and value - value != 0:
        return None
    return value
