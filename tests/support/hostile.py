"""Stores, notebooks and histories whose texts try to steer the terminal and the application."""

from __future__ import annotations

import json
from pathlib import Path

import duckdb

from bench.edited_index import Statement, edited
from s2rstore.gap_history import reader
from s2rstore.gap_history import schema as history_schema
from s2rstore.index import schema
from tests.support.copies import copy_store

CLIPBOARD = "\x1b]52;c;aGFja2Vk\x07"
"""A complete OSC 52 sequence: a terminal that obeys writes the user's clipboard."""
C1 = "\x9b31m\x85"
BIDI = "\u202e\u2066\u2069\u200f"
MARKUP = "[ @click=app.quit]CLICK[/] [/ [b $\\frac$"
HOSTILE = f"{CLIPBOARD}{C1}{BIDI}\u2028\u2029\x7f\x00\r\n\t{MARKUP}".replace("\x00", "")
"""All of it in one name."""

_CHECKED = {"run", "model", "domain", "trajectory", "hash", "key", "sha256", "path", "dtype",
            "shape", "axes", "kind", "side", "mode", "split", "floor_plan", "sim_domain",
            "real_domain", "sim_adjustments", "real_adjustments", "source",
            "convention", "metadata_sha256"}  # fmt: skip
"""Columns that are more than text to show: they have tests of their own."""
FREE = tuple(
    (table.name, column.name)
    for table in schema.TABLES
    for column in table.columns
    if column.type == "VARCHAR" and column.name not in _CHECKED
)
"""Table and column of all text that a store may hold as it likes."""


def edit(store: Path, *statements: Statement) -> Path:
    """Change the published index in place, as somebody who sends a store can."""
    edited(store, statements)
    return store


def with_hostile_texts(source: Path, target: Path, text: str = HOSTILE) -> Path:
    """A copy of a store with `text` in every free text column; rooms keep distinct ends."""
    store = copy_store(source, target)
    changes: list[Statement] = []
    for table, column in FREE:
        if column == "room":
            changes.append((f"UPDATE {table} SET room = ? || room", [text]))
        elif (table, column) != ("provenance", "what"):
            changes.append((f'UPDATE "{table}" SET "{column}" = ?', [text]))
    adjustments = json.dumps([{"name": text, "value": 1.5}])
    changes += [
        ("UPDATE run SET sim_adjustments = ?", [adjustments]),
        ("UPDATE model SET convention = ?", [json.dumps({"heading": text})]),
        ("UPDATE domain SET source = ?", [json.dumps({"cameras": text})]),
        ("INSERT INTO provenance VALUES ('dataset', ?, ?)", [text, text]),
        ("INSERT INTO provenance VALUES ('score', 'report', ?)", [json.dumps({"runs": [text]})]),
    ]
    return edit(store, *changes)


def with_nights(store: Path, text: str = HOSTILE) -> Path:
    """Give a store a history of two nights whose texts are `text`."""
    path = reader.history_path(store)
    path.parent.mkdir(exist_ok=True)
    told = {"worst", "reason", "headline", "golden", "expression", "model", "name", "evidence",
            "run_key", "written_at", "outcome"}  # fmt: skip
    with duckdb.connect(str(path)) as connection:
        for statement in history_schema.statements():
            connection.execute(statement)
        for number in (1, 2):
            row: dict[str, object] = {}
            for column in history_schema.TABLES[0].columns:
                fixed = {
                    "id": number,
                    "night": f"2026-01-0{number}",
                    "measured": number,
                    "dataset": text,
                    "run": "vanilla",
                    "evidence_since": "2026-01-01",
                }
                plain = {"VARCHAR": "x", "INTEGER": 0, "DOUBLE": 9.0, "DATE": "2026-01-01"}
                value = fixed.get(column.name, plain[column.type])
                row[column.name] = text if column.name in told else value
            _insert(connection, "night", row)
            axis = {c.name: 9.0 for c in history_schema.TABLES[1].columns} | {
                "measured": number, "position": 0, "axis": text, "state": text, "measure": text,
                "unit": text, "n": 5, "note": text,
            }  # fmt: skip
            _insert(connection, "axis", axis)
    return store


def _insert(connection: duckdb.DuckDBPyConnection, table: str, row: dict[str, object]) -> None:
    names = ", ".join(f'"{name}"' for name in row)
    marks = ", ".join("?" * len(row))
    connection.execute(f'INSERT INTO "{table}" ({names}) VALUES ({marks})', list(row.values()))


def notebook(folder: Path, dataset_hash: str = "0" * 64, **sections: object) -> Path:
    """Write a notebook's file as somebody who shares an account, or a home, can."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{dataset_hash[:16]}.json"
    content = {"version": 1, "dataset": dataset_hash, **sections}
    path.write_text(json.dumps(content))
    return path


def saved(expression: str, **changes: object) -> dict[str, object]:
    """A notebook's entry of a saved selection."""
    facts = {"generation": 1, "run": "vanilla", "count": 1, "trajectories": None}
    return {"expression": expression, **facts, **changes}


def control_characters(text: str) -> set[str]:
    """What of a text steers a terminal; line feeds do not."""
    return {c for c in text if not c.isprintable() and c != "\n"}
