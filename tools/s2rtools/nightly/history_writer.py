"""Adding to the history: a copy grows and takes the file's place, so readers never see half."""

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
from s2rstore.files import layout
from s2rstore.gap_history import reader, schema
from s2rstore.gap_history.gate_status import EXIT_CODES
from s2rstore.gap_history.reader import History, Night
from s2rstore.index import locked_connection
from s2rstore.index.schema import STORAGE_VERSION, Table
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.input_fingerprint import Inputs, version
from s2rtools.nightly.measurement import Estimates, Report
from s2rtools.nightly.night_status import outcome

Change = Callable[[duckdb.DuckDBPyConnection], None]
Rows = dict[str, list[dict[str, Any]]]
_FIGURES = ("value", "floor", "gap")
_ENDS = ("", "_low", "_high")


@dataclass(frozen=True, slots=True)
class Tonight:
    """What is to be added; with `measured` the figures are those of that measurement."""

    config: NightlyConfig
    inputs: Inputs
    night: datetime.date
    report: Report
    estimates: Estimates = ()
    measured: int | None = None


def known(path: Path) -> History:
    """What is there, which may be nothing."""
    return reader.read(path) if path.exists() else History()


def last_of(found: History, name: str, night: datetime.date) -> Night | None:
    """The row that counts for a night."""
    return next((each for each in found.counting(name) if each.night == night), None)


def measurement(found: History, key: str) -> int | None:
    """The measurement that was made of the same evidence in the same way; refused ones are none."""
    return next((n.measured for n in found.nights if n.key == key and not n.refused), None)


def tells(night: Night | None, tonight: Tonight, found: History) -> bool:
    """Whether a row already says what tonight would."""
    if night is None or night.key != tonight.inputs.key:
        return False
    if night.evidence_since < max(_seen(tonight, found).values()):
        return False  # it was dated by a night that has been withdrawn
    refused = tonight.report.get("refused")
    if refused is None:
        return not night.refused
    return night.refused and (night.outcome, night.reason) == (
        refused["outcome"],
        refused["reason"],
    )


def rows(tonight: Tonight, found: History, now: datetime.datetime) -> Rows:
    """The rows that tonight adds to each table."""
    number = found.last_id + 1
    measured = number if tonight.measured is None else tonight.measured
    seen = _seen(tonight, found)
    made: Rows = {
        "night": [_night_row(tonight, max(seen.values()), number, measured, now)],
        "recorded": [
            {"name": tonight.config.name, "part": part, "night": night}
            for part, night in seen.items()
            if found.recorded.get((tonight.config.name, part)) != night
        ],
    }
    if tonight.measured is None:
        report = json.dumps(tonight.report, indent=1, sort_keys=True, allow_nan=False)
        made["axis"] = [{"measured": number, **row} for row in _axis_rows(tonight.report)]
        made["estimate"] = [
            {"measured": number, "position": position, **row}
            for position, row in enumerate(tonight.estimates)
        ]
        made["report"] = [{"measured": number, "report": report, "version": version()}]
    return made


def _seen(tonight: Tonight, found: History) -> dict[str, datetime.date]:
    """The first night of each part of the evidence."""
    name, night = tonight.config.name, tonight.night
    return {
        part: min(night, found.recorded.get((name, part), night)) for part in tonight.inputs.parts
    }


def _night_row(
    tonight: Tonight, since: datetime.date, number: int, measured: int, now: datetime.datetime
) -> dict[str, Any]:
    config, report, verdict = tonight.config, tonight.report, tonight.report["verdict"]
    golden = report["golden"] or {}
    age = (tonight.night - since).days
    word = outcome(report, age > config.stale_after)
    return {
        "id": number,
        "name": config.name,
        "night": tonight.night,
        "key": tonight.inputs.key,
        "evidence": tonight.inputs.evidence,
        "measured": measured,
        "dataset": report["dataset"]["name"],
        "dataset_hash": report["dataset"]["hash"],
        "run": report["run"],
        "run_key": report["run_key"],
        "model": report["model"],
        "expression": report["expression"],
        "outcome": word,
        "exit_code": EXIT_CODES[word],
        "headline": verdict["outcome"],
        **{f"gap{end}": verdict.get(f"gap{end}") for end in _ENDS},
        "worst": verdict["worst"],
        "threshold": verdict["threshold"],
        "reason": verdict["reason"],
        "golden": golden.get("outcome"),
        **{f"golden_change{end}": golden.get(f"change{end}") for end in _ENDS},
        "golden_margin": golden.get("margin"),
        "evidence_since": since,
        "evidence_age": age,
        "stale_after": config.stale_after,
        "written_at": now.astimezone(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
    }


def _axis_rows(report: Report) -> list[dict[str, Any]]:
    made: list[dict[str, Any]] = []
    for each in report["axes"]:
        figures = {f"{name}{end}": each.get(f"{name}{end}") for name in _FIGURES for end in _ENDS}
        note = "; ".join(each["notes"]) or None
        plain = {name: each.get(name) for name in ("axis", "measure", "unit", "anchor", "n")}
        made.append({**plain, **figures, "state": "measured", "note": note})
    for state in ("inconclusive", "absent"):
        made += [{"axis": name, "state": state, "note": why} for name, why in report[state].items()]
    return [{"position": position, **row} for position, row in enumerate(made)]


def append(path: Path, added: Rows) -> None:
    """Add rows, all or none, durably; hold the file's lock. RequestError where it cannot be."""
    _replace(path, partial(_add, added))


def move(path: Path, name: str, night: datetime.date, now: str) -> None:
    """Withdraw a night: move its rows to the tables of withdrawn nights, all or none."""
    _replace(path, partial(_withdraw, name, night, now))


def _replace(path: Path, change: Change) -> None:
    reader.check_place(path)
    beside = path.with_name(f".{path.name}.{os.getpid()}.new")
    try:
        for left in path.parent.glob(f".{path.name}.*.new*"):
            left.unlink(missing_ok=True)
        _write(beside, path if path.exists() else None, change)
        beside.chmod(0o644)
        layout.sync_file(beside)
        beside.replace(path)
        layout.sync_folder(path.parent)
    except (OSError, duckdb.Error) as error:
        told = str(error).splitlines()[0]
        raise RequestError(f"{path}: cannot be written ({told})") from error
    finally:
        for name in (beside, beside.with_name(f"{beside.name}.wal")):
            with suppress(OSError):
                name.unlink(missing_ok=True)


def _write(path: Path, base: Path | None, change: Change) -> None:
    """A new file with the rows of `base`, changed; its views are made anew."""
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
    values = [_known(value) for value in row.values()]
    connection.execute(f'INSERT INTO "{table}" ({names}) VALUES ({marks})', values)


def _known(value: Any) -> Any:
    """NULL for what is not finite."""
    if isinstance(value, float) and value - value != 0:
        return None
    return value
