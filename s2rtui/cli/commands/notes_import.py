"""`s2r import`: take notes and tags of instances from a CSV file into the user's notebook."""

from __future__ import annotations

import argparse
from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError, counted, shortened
from s2rtools.common.command_line import store_argument
from s2rtools.common.tables.csv_rows import missing_column, read_rows
from s2rtui.cli.command_parser import Command
from s2rtui.user_data.notebook import Notebook, Remark
from s2rtui.user_data.notebook_schema import valid_tag


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    store_argument.add_readable(parser)
    parser.add_argument("file", type=Path, metavar="FILE",
                        help="CSV file with column iid and note, tags or both; tags are separated "
                        "by blanks")  # fmt: skip


def _execute(options: argparse.Namespace) -> int:
    with s2rstore.open(options.store) as store:
        remarks = _read(options.file, len(store.instances))
        count = Notebook(store.identity, parts=store.parts).add_remarks(remarks)
    print(f"{options.store}: new notes or tags of {counted(count, 'instance')}")
    return 0


def _read(path: Path, count: int) -> dict[int, Remark]:
    """Remarks by instance, without empty ones.

    Raises RequestError for an instance that the store does not have, and an invalid tag.
    """
    remarks: dict[int, Remark] = {}

    def check(names: list[str]) -> None:
        if "iid" not in names or not {"note", "tags"} & set(names):
            missing = "note" if "iid" in names else "iid"
            raise missing_column(path, missing, names, "iid, note, tags")

    for number, row in read_rows(path, ("iid", "note", "tags"), check):
        text = row["iid"]
        if not (text.isdecimal() and len(text) < 12 and int(text) < count):
            iid = repr(shortened(text))
            raise RequestError(f"{path}:{number}: iid {iid}: the store holds 0 .. {count - 1}")
        try:
            tags = [valid_tag(tag) for tag in row.get("tags", "").split()]
        except RequestError as error:
            raise RequestError(f"{path}:{number}: {error}") from None
        before = remarks.get(int(text), Remark())
        remark = Remark((*before.tags, *tags), row.get("note") or before.note)
        if remark != Remark():
            remarks[int(text)] = remark
    return remarks


COMMANDS = {"import": Command("s2r import lab.s2r notes.csv", _add_arguments, _execute)}
