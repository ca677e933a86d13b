"""Cost of one more run in a store of 10 and of 100 runs: `python -m bench growth`.

The stores have 10^6 instances. Their first runs are published as usual; the files of rows of the
others are hard links to those of the first, since their content does not matter to a writer, which
leaves them as they are. Timed is what publishing does after the arrays of the run are read: from
the start of `edit` to the new generation on the disk.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import s2rstore
from bench import index_store
from bench.budget import BudgetRow, seconds
from bench.edited_index import Statement, edited
from s2rstore.files import layout, safe_files
from s2rstore.index import row_files, schema
from s2rstore.index.row_files import RowFile
from s2rstore.index.transaction import IndexTransaction, edit

INSTANCES = 1_000_000
RUNS = (10, 100)
_TIMES = 3

Columns = dict[str, dict[str, Any]]


def store_of_runs(path: Path, count: int) -> Path:
    """A store of 10^6 instances with `count` runs, all but two with rows of the first one."""
    root = index_store.build(path, INSTANCES, runs=index_store.RUNS[:2])
    _add_runs(root, count)
    return root


def linked_name(number: int) -> str:
    """The name of a run of `store_of_runs`, from 2 on."""
    return f"linked-{number:03d}"


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Measure stores that are built in `folder`."""
    root = store_of_runs(folder / "growth.s2r", RUNS[0])
    rows = _rows()
    times = {}
    for count in RUNS:
        _add_runs(root, count)
        times[count], taken = _publish(root, rows, count)
        name = f"{count} runs of {INSTANCES:.0e} instances"
        yield BudgetRow(f"{name}: add and publish one run", times[count], "s", 20.0)
        yield BudgetRow(f"{name}: a generation without new rows", taken, "s", 20.0)
        opened = seconds(lambda: s2rstore.open(root).close(), _TIMES)
        yield BudgetRow(f"{name}: open the store", opened, "s", 1.0)
    few, many = RUNS
    ratio = times[many] / times[few]
    yield BudgetRow(f"add and publish one run: {many} runs over {few}", ratio, "", 1.5)
    before = _bytes(root)
    with edit(root) as draft:
        draft.set_provenance("bench", {"a": "b"})
    yield BudgetRow("bytes of a generation without new rows", _bytes(root) - before, "bytes", 150e6)


def _rows() -> dict[str, Columns]:
    """Random rows of both sides of a run, by table and side."""
    rng = np.random.default_rng(5)
    iids = np.arange(INSTANCES, dtype=np.int32)
    made: dict[str, Columns] = {"prediction": {}, "projection": {}}
    for table, columns in made.items():
        for side in ("sim", "real"):
            columns[side] = {
                column.name: rng.random(INSTANCES)
                for column in schema.BY_NAME[table].columns
                if column.type == "DOUBLE"
            }
            columns[side] |= {"iid": iids, "side": np.full(INSTANCES, side, dtype=object)}
        if table == "prediction":
            for of_side in columns.values():
                of_side["rank"] = rng.permutation(INSTANCES).astype(np.int32) + 1
                of_side["split"] = np.full(INSTANCES, "unseen", dtype=object)
    return made


def _publish(root: Path, rows: dict[str, Columns], count: int) -> tuple[float, float]:
    """Seconds to add a run, and to publish without new rows, each the median of several."""
    added, empty = [], []
    for number in range(_TIMES):
        began = time.perf_counter()
        with edit(root) as draft:
            _insert_run(draft, f"new-{count}-{number}", rows)
        middle = time.perf_counter()
        with edit(root) as draft:
            draft.set_provenance("bench", {"number": number})
        added.append(middle - began)
        empty.append(time.perf_counter() - middle)
    return median(added), median(empty)


def _insert_run(draft: IndexTransaction, run: str, rows: dict[str, Columns]) -> None:
    draft.insert_row("run", index_store.run_row(run, 0))
    for table, columns in rows.items():
        for of_side in columns.values():
            name = np.full(INSTANCES, run, dtype=object)
            draft.insert(table, {"run": name, **of_side})


def _add_runs(root: Path, count: int) -> None:
    """List runs up to `count`, whose files are hard links to those of the first run."""
    with s2rstore.open(root) as store:
        present, listed = len(store.runs), store.row_files
    names = [linked_name(number) for number in range(present, count)]
    statements: list[Statement] = [f"SET file_search_path = '{root / layout.INDEX}'"]
    for run in names:
        row = {**index_store.run_row(run, 0), "sim_adjustments": "[]", "real_adjustments": "[]"}
        marks = ", ".join("?" * len(row))
        statements.append((f"INSERT INTO run ({', '.join(row)}) VALUES ({marks})", [*row.values()]))
    for table in ("prediction", "projection"):
        first = listed[table][0]
        files = [_linked(root, first, run) for run in names]
        for f in files:
            values: list[object] = [f.table, f.run, f.path, f.sha256, f.bytes, f.rows]
            query = f"INSERT INTO {row_files.TABLE} VALUES (?, ?, ?, ?, ?, ?)"
            statements.append((query, values))
        every = sorted([*listed[table], *files], key=lambda file: str(file.run))
        view = row_files.view(table, every)
        statements.append(view.replace("CREATE VIEW", "CREATE OR REPLACE VIEW", 1))
    edited(root, statements)


def _linked(root: Path, file: RowFile, run: str) -> RowFile:
    link = replace(file, run=run, path=row_files.path_of(file.table, run, file.sha256))
    folder = root / layout.INDEX
    (folder / link.path).parent.mkdir()
    os.link(folder / file.path, folder / link.path)
    return link


def _bytes(root: Path) -> int:
    """Bytes of all indexes and files of rows."""
    return sum(entry.bytes for entry in safe_files.walk(root, layout.INDEX))
