"""`s2r import`: take notes and tags of instances from a CSV file into the user's notebook."""

from __future__ import annotations

import argparse
from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError, counted
from s2rtools.common.command_line import store_argument
from s2rtools.common.tables.csv_rows import missing_column, read_rows
from s2rtui.cli.command_parser import Command
from s2rtui.user_data.notebook import Notebook, Remark


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("file", type=Path, metavar="FILE",
                        help="CSV file with column iid and note, tags or both; tags are separated "
                        "by blanks")  # fmt: skip


def _execute(options: argparse.Namespace) -> int:
    with s2rstore.open(options.store) as store:
        remarks = _read(options.file, len(store.instances))
        Notebook(store.identity, parts=store.parts).add_remarks(remarks)
    print(f"{options.store}: notes and tags of {counted(len(remarks), 'instance')}")
    return 0


def _read(path: Path, count: int) -> dict[int, Remark]:
    """Remarks by instance. Raises RequestError for one that the store does not have."""
    remarks: dict[int, Remark] = {}

    def check(names: list[str]) -> None:
        if "iid" not in names or not {"note", "tags"} & set(names):
            missing = "note" if "iid" in names else "iid"
            raise missing_column(path, missing, names, "iid, note, tags")

    for number, row in read_rows(path, ("iid", "note", "tags"), check):
        text = row["iid"]
        if not text.isdecimal() or int(text) >= count:
            raise RequestError(f"{path}:{number}: iid {text!r}: the store holds 0 .. {count - 1}")
        tags = tuple(tag.lstrip("#") for tag in row.get("tags", "").split())
        before = remarks.get(int(text), Remark())
        note = row.get("note") or before.note
        remarks[int(text)] = Remark(tuple(dict.fromkeys((*before.tags, *tags))), note)
    return remarks


COMMANDS = {"import": Command("s2r import lab.s2r notes.csv", _add_arguments, _execute)}
