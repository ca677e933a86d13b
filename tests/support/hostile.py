"""Stores, notebooks and histories whose texts contain terminal escapes, markup and controls."""

import json
from dataclasses import replace
from pathlib import Path

from bench.edited_index import Statement, edited
from s2rstore.gap_history import reader, writer
from s2rstore.index import schema
from tests.support import gaps
from tests.support.copies import copy_store

CLIPBOARD = "\x1b]52;c;aGFja2Vk\x07"
"""A complete OSC 52 sequence, with which a terminal overwrites the user's clipboard."""
C1 = "\x9b31m\x85"
BIDI = "\u202e\u2066\u2069\u200f"
MARKUP = "[ @click=app.quit]CLICK[/] [/ [b $\\frac$"
HOSTILE = f"{CLIPBOARD}{C1}{BIDI}\u2028\u2029\x7f\x00\r\n\t{MARKUP}".replace("\x00", "")
"""All hostile sequences in one text."""

_VALIDATED = {"run", "model", "domain", "trajectory", "hash", "key", "sha256", "path", "dtype",
            "shape", "axes", "kind", "side", "mode", "split", "floor_plan", "sim_domain",
            "real_domain", "sim_adjustments", "real_adjustments", "source",
            "convention", "metadata_sha256", "table_name", "input",
            "recall_thresholds"}  # fmt: skip
"""Columns whose content is validated and tested separately."""
FREE_TEXT_COLUMNS = tuple(
    (table.name, column.name)
    for table in schema.TABLES
    for column in table.columns
    if column.type == "VARCHAR" and column.name not in _VALIDATED
)
"""Table and column of every text that may have any content."""


def edit(store: Path, *statements: Statement) -> Path:
    """Modify the published index in place, as the author of a malicious store can."""
    edited(store, statements)
    return store


def with_hostile_texts(source: Path, target: Path, text: str = HOSTILE) -> Path:
    """Copy a store with `text` in every free text column; room names stay distinct."""
    store = copy_store(source, target)
    statements: list[Statement] = []
    for table, column in FREE_TEXT_COLUMNS:
        if column == "room":
            statements.append((f"UPDATE {table} SET room = ? || room", [text]))
        elif table == "provenance" and column != "what":
            changed = f"UPDATE provenance SET {column} = ? WHERE what <> '{schema.CHECKSUMS}'"
            statements.append((changed, [text]))
        elif column != "what":
            statements.append((f'UPDATE "{table}" SET "{column}" = ?', [text]))
    adjustments = json.dumps([{"name": text, "value": 1.5}])
    statements += [
        ("UPDATE run SET sim_adjustments = ?", [adjustments]),
        ("UPDATE model SET convention = ?", [json.dumps({"heading": text})]),
        ("UPDATE domain SET source = ?", [json.dumps({"cameras": text})]),
        ("INSERT INTO provenance VALUES ('dataset', ?, ?)", [text, text]),
        ("INSERT INTO provenance VALUES ('score', 'report', ?)", [json.dumps({"runs": [text]})]),
    ]
    return edit(store, *statements)


def with_nights(store: Path, text: str = HOSTILE) -> Path:
    """Add a history of two nights whose texts are `text` to a store."""
    path = reader.history_path(store)
    path.parent.mkdir(exist_ok=True)
    names = ("worst", "reason", "headline", "golden", "expression", "model", "name", "evidence",
             "run_key", "written_at", "outcome", "dataset")  # fmt: skip
    for number in (1, 2):
        night = gaps.night(number, {text: 9.0}, **dict.fromkeys(names, text))
        axes = [
            replace(each, state=text, measure=text, unit=text, note=text) for each in night.axes
        ]
        writer.append(path, replace(night, axes=tuple(axes)))
    return store


def notebook(folder: Path, store_identity: str = "0" * 64, **sections: object) -> Path:
    """Write a notebook file, as anyone with access to the home folder can."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{store_identity[:16]}.json"
    content = {"version": 1, "dataset": store_identity, **sections}
    path.write_text(json.dumps(content))
    return path


def saved_entry(expression: str, **changes: object) -> dict[str, object]:
    """The entry of a saved selection in a notebook file."""
    defaults = {"generation": 1, "run": "vanilla", "count": 1, "trajectories": None}
    return {"expression": expression, **defaults, **changes}


def control_characters(text: str) -> set[str]:
    """The non-printable characters of a text other than line feeds.

    Octants, block characters of Unicode 16 that older versions of Python do not know, do not count.
    """
    return {
        c
        for c in text
        if not c.isprintable() and c != "\n" and not "\U0001cd00" <= c <= "\U0001cde5"
    }
