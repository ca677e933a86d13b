"""Rows in Parquet files beside the index: same results, shared by generations, and checked."""

import contextlib
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import duckdb
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import s2rstore
from bench.edited_index import edited
from s2rstore.errors import DamagedStoreError, RequestError
from s2rstore.files import layout
from s2rstore.index import row_files, schema
from s2rstore.index.table_definition import Column
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from tests.store.conftest import row_file, row_files_of
from tests.support.copies import copy_store
from tests.support.refusals import refused

_TABLES = ("instance", "frame", "prediction", "projection", "run", "part", "pair", "provenance")


def _rows(root: Path, source: str) -> list[tuple[object, ...]]:
    """The rows of a table or of a query in parentheses, sorted."""
    with s2rstore.open(root) as store:
        return sorted(store.execute(f"FROM {source}"), key=repr)


def test_tables_columns_and_selections_are_the_same(source, tiny_store):
    for table in _TABLES:
        assert _rows(source, table) == _rows(tiny_store, table), table
    with s2rstore.open(source) as one, s2rstore.open(tiny_store) as other:
        for table in ("frame", "prediction", "projection", "pair"):
            described = [store.execute(f'DESCRIBE "{table}"') for store in (one, other)]
            assert described[0] == described[1]
        for text in ('worst15 & run("dataaug").real.error > 0.3', "umap.real(0,0,9,9)"):
            masks = [evaluation.select(store, text, run="vanilla") for store in (one, other)]
            np.testing.assert_array_equal(masks[0], masks[1])
        for run in other.runs:
            for side in ("sim", "real"):
                found, expected = (s.run_columns(run).side(side) for s in (one, other))
                for name in ("x", "heading", "error", "rank", "split", "u", "outlier"):
                    np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_a_change_of_one_run_writes_the_files_of_that_run_alone(filed):
    before = row_files_of(filed)
    with edit(filed) as draft:
        draft.update("prediction", {"run": "vanilla", "side": "sim"}, {"split": "train"})
        query = "SELECT run, sim_split, count(*) FROM pair GROUP BY ALL ORDER BY 1, 2"
        rows = draft.rows(query)
        assert rows[-1] == ("vanilla", "train", 40)
    added = row_files_of(filed).keys() - before.keys()
    assert [path.rpartition("/")[0] for path in added] == ["rows/prediction/vanilla"]
    assert {path: row_files_of(filed)[path] for path in before} == before
    assert _rows(filed, f"({query})") == sorted(rows, key=repr)


def test_rows_are_added_to_those_of_a_file(filed):
    with edit(filed) as draft:
        draft.insert("prediction", {"run": ["vanilla"], "iid": [77], "side": ["sim"]})
        draft.insert("frame", {"iid": [77], "domain": ["sim"]})
    with s2rstore.open(filed) as store:
        assert len(store.row_files["prediction"]) == 2
        assert len(store.row_files["frame"]) == 2
        query = "SELECT count(*) FROM {} WHERE iid = 77"
        assert store.execute(query.format("prediction")) == [(1,)]
        assert store.execute(query.format("frame")) == [(1,)]
    with pytest.raises(RequestError, match="already"), edit(filed) as draft:
        draft.insert("frame", {"iid": [77], "domain": ["sim"]})
    with s2rstore.open(filed) as store:
        assert len(store.row_files["frame"]) == 2


def test_a_table_without_rows_is_no_view(filed):
    with edit(filed) as draft:
        draft.delete("projection")
        draft.delete("prediction", side="real")
        draft.delete("prediction", side="sim")
        draft.delete("label_gain")
    with s2rstore.open(filed) as store:
        assert set(store.row_files) == {"frame", "frame_label"}
        assert store.execute("SELECT count(*) FROM prediction") == [(0,)]
    with edit(filed) as draft:
        draft.insert("prediction", {"run": ["vanilla"], "iid": [0], "side": ["sim"]})
    with s2rstore.open(filed) as store:
        assert set(store.row_files) == {"frame", "frame_label", "prediction"}


_CHANGES = st.lists(
    st.tuples(
        st.sampled_from(["delete run", "delete side", "update", "insert", "publish"]),
        st.sampled_from(["vanilla", "dataaug", "new+1.x"]),
        st.sampled_from(["sim", "real"]),
        st.integers(0, 39),
    ),
    min_size=1,
    max_size=6,
)


@given(changes=_CHANGES)
@settings(
    max_examples=6,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)  # fmt: skip
def test_any_changes_give_the_rows_of_a_store_without_files(
    changes, tiny_store, tmp_path_factory, monkeypatch
):
    folder = tmp_path_factory.mktemp("changes")
    results = []
    for limit in (0, 10**9):
        root = copy_store(tiny_store, folder / f"{limit}.s2r")
        monkeypatch.setattr(row_files, "MAX_ROWS", limit)
        waiting = list(changes)
        while waiting:
            with edit(root) as draft:
                while waiting:
                    what, run, side, iid = waiting.pop(0)
                    if what == "delete run":
                        draft.delete("prediction", run=run)
                        draft.delete("projection", run=run)
                    elif what == "delete side":
                        draft.delete("prediction", run=run, side=side)
                    elif what == "update":
                        draft.update("prediction", {"side": side, "iid": str(iid)}, {"x": 1.5})
                    elif what == "insert":
                        row = {"run": run, "iid": iid, "side": side}
                        draft.insert_row("prediction", row | {"x": 0.1 * iid})
                        draft.insert_row("projection", row | {"u": None})
                    else:
                        break
        results.append([_rows(root, table) for table in ("prediction", "projection", "pair")])
    assert results[0] == results[1]


@pytest.mark.parametrize(
    ("damage", "hint"),
    [
        (lambda path: path.unlink(), "missing"),
        (lambda path: path.write_bytes(path.read_bytes()[:-9]), "bytes instead of"),
        (lambda path: _link(path), "symbolic link"),
        (lambda path: _fifo(path), "pipe"),
        (lambda path: path.write_bytes(b"x" * path.stat().st_size), "arquet"),
    ],
)  # fmt: skip
def test_a_damaged_file_is_refused_and_named(filed, damage, hint):
    path = row_file(filed)
    damage(path)
    with refused(path.name, match=hint):
        s2rstore.open(filed)
    found = {damage.where: damage.what for damage in verify(filed)}
    assert f"index/rows/prediction/vanilla/{path.name}" in found
    assert not any("dataaug" in what for what in (*found, *found.values()))


def _link(path: Path) -> None:
    target = path.with_name("target")
    path.rename(target)
    path.symlink_to(target)


def _fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


def test_verify_finds_changed_content_of_the_same_size(filed):
    path = row_file(filed)
    content = bytearray(path.read_bytes())
    content[200] ^= 1
    path.write_bytes(content)
    (found,) = (damage for damage in verify(filed) if damage.where.endswith(path.name))
    assert found.what == "its checksum is not the published one"


def test_verify_finds_other_damage_beside_a_missing_file(filed):
    row_file(filed).unlink()
    shard = next((filed / "runs.zarr").rglob("c.0.*"))
    shard.unlink()
    places = [damage.where for damage in verify(filed)]
    assert shard.relative_to(filed).as_posix() in places
    assert any(place.startswith("index/rows/prediction/vanilla/") for place in places)


def test_an_unlisted_file_is_ignored_and_pruned(filed):
    extra = row_file(filed).with_name("0123456789abcdef.parquet")
    shutil.copy(row_file(filed, "dataaug"), extra)
    partial = extra.with_name(".0123.partial")
    partial.write_bytes(b"")
    before = _rows(filed, "prediction")
    with s2rstore.open(filed) as store:
        assert store.execute("SELECT count(*) FROM prediction") == [(160,)]
    removed = prune(filed, keep=9).paths
    assert sorted(removed) == sorted(
        path.relative_to(filed).as_posix() for path in (extra, partial)
    )
    assert _rows(filed, "prediction") == before


def test_prune_keeps_the_files_of_kept_generations(filed):
    with edit(filed) as draft:
        draft.delete("prediction", run="vanilla")
        draft.delete("projection", run="vanilla")
    old = layout.read_current(filed).generation - 1
    before = row_files_of(filed)
    assert not any("rows" in path for path in prune(filed, keep=2).paths)
    assert row_files_of(filed) == before
    with s2rstore.reader.Store(filed, generation=old) as store:
        assert store.execute("SELECT count(*) FROM pair") == [(80,)]
    removed = prune(filed, keep=1).paths
    assert sum("rows/prediction/vanilla" in path for path in removed) == 1
    assert not (filed / "index" / "rows" / "prediction" / "vanilla").exists()
    assert _rows(filed, "(SELECT run, count(*) FROM prediction GROUP BY run)") == [("dataaug", 80)]


def test_a_failed_edit_leaves_neither_generation_nor_files(filed):
    current, before = layout.read_current(filed), row_files_of(filed)
    with contextlib.suppress(ZeroDivisionError), edit(filed) as draft:
        draft.update("prediction", {"run": "vanilla"}, {"x": 3.0})
        raise ZeroDivisionError
    with pytest.raises(RequestError, match="run"), edit(filed) as draft:
        draft.insert("prediction", {"run": ["a", "../x"], "iid": [1, 1], "side": ["sim", "sim"]})
    assert layout.read_current(filed) == current
    assert row_files_of(filed) == before
    assert not list((filed / "index").glob(".building*"))
    assert verify(filed) == []


_KILLED = """
import os, sys
from pathlib import Path
from s2rstore.files import atomic_writes, layout
from s2rstore.index import row_files, transaction
row_files.MAX_ROWS = 0
where = sys.argv[2]
def killed(*arguments, **options):
    os._exit(9)
if where == "files written":
    transaction.FileTables.finish = killed
else:
    layout.write_current = killed
with transaction.edit(Path(sys.argv[1])) as draft:
    draft.update("prediction", {"run": "vanilla"}, {"x": 3.0})
"""


@pytest.mark.parametrize("where", ["files written", "index in place"])
def test_a_kill_during_publishing_leaves_the_old_generation(filed, where):
    current, before = layout.read_current(filed), _rows(filed, "pair")
    files = row_files_of(filed)
    command = [sys.executable, "-c", _KILLED, str(filed), where]
    assert subprocess.run(command, check=False).returncode == 9
    assert layout.read_current(filed) == current
    assert _rows(filed, "pair") == before
    assert verify(filed) == []
    assert len(row_files_of(filed)) == len(files) + 1
    prune(filed, keep=1)
    assert row_files_of(filed) == files


@pytest.mark.parametrize(
    "statement",
    [
        "CREATE OR REPLACE VIEW prediction AS SELECT * FROM read_csv('/etc/passwd')",
        "CREATE OR REPLACE VIEW projection AS SELECT 'a' AS run, iid, side, 0.0 AS u, 0.0 AS v "
        "FROM read_parquet(['rows/frame/*.parquet'], filename = true, hive_partitioning = false), "
        "(SELECT 'sim' AS side)",
        "UPDATE row_file SET path = '/etc/passwd' WHERE table_name = 'frame'",
        "UPDATE row_file SET path = 'rows/frame/../../x' WHERE table_name = 'frame'",
        "UPDATE row_file SET run = '../x' WHERE run = 'vanilla'",
        "UPDATE row_file SET table_name = 'run' WHERE table_name = 'frame'",
        "UPDATE row_file SET row_count = 1000000000 WHERE run = 'vanilla'",
        "UPDATE row_file SET bytes = NULL",
        "UPDATE row_file SET sha256 = NULL",
        "DELETE FROM row_file WHERE run = 'vanilla'",
        "DELETE FROM row_file",
        "INSERT INTO row_file SELECT * FROM row_file",
        "DROP TABLE row_file",
        "DROP VIEW prediction",
        "ALTER TABLE row_file ALTER COLUMN bytes TYPE VARCHAR",
    ],
)  # fmt: skip
def test_a_list_of_files_that_no_store_has_is_refused(filed, statement):
    index = filed / layout.read_current(filed).index
    with duckdb.connect(str(index)) as connection:
        connection.execute(f"SET file_search_path = '{index.parent}'")
        connection.execute(statement)
    edited(filed, [])
    with refused():
        s2rstore.open(filed)
    with pytest.raises(RequestError), edit(filed):
        pass


def test_another_number_of_rows_than_listed_is_refused(filed):
    edited(filed, ["UPDATE row_file SET row_count = 81 WHERE table_name = 'prediction'"])
    with pytest.raises(RequestError, match="80 rows instead of 81"):
        s2rstore.open(filed)


def test_files_of_the_working_folder_are_not_read(filed, tiny_store, tmp_path, monkeypatch):
    folder = tmp_path / "working"
    shutil.copytree(filed / "index" / "rows", folder / "rows")
    for path in (folder / "rows").rglob("*.parquet"):
        path.write_bytes(b"PAR1")
    monkeypatch.chdir(folder)
    assert _rows(filed, "pair") == _rows(tiny_store, "pair")
    assert verify(filed) == []
    generation = layout.read_current(filed).generation
    with pytest.raises(RequestError, match="another folder"), edit(filed):
        pass
    assert layout.read_current(filed).generation == generation
    monkeypatch.chdir("/")
    assert _rows(filed, "pair") == _rows(tiny_store, "pair")


def test_a_reader_of_a_removed_generation_is_told_to_open_the_store_again(filed):
    with s2rstore.open(filed) as store:
        with edit(filed) as draft:
            draft.delete("prediction", run="vanilla")
        prune(filed, keep=1)
        with pytest.raises(DamagedStoreError, match="open the store again"):
            store.execute("SELECT sum(error) FROM prediction WHERE run = 'vanilla'")
        with pytest.raises(RequestError, match="open the store again"):
            store.run_columns("vanilla").real.error.sum()


def test_rows_in_files_without_a_needed_column_are_refused(filed, monkeypatch):
    table = schema.BY_NAME["prediction"]
    columns = (*table.columns, Column("needed", "FLOAT", "new"))
    monkeypatch.setitem(schema.BY_NAME, "prediction", replace(table, columns=columns))
    with pytest.raises(RequestError, match="other columns"):
        s2rstore.open(filed)


def test_rows_that_are_published_again_take_their_file_which_is_repaired(filed):
    path, before = row_file(filed), row_files_of(filed)
    content = path.read_bytes()
    for is_damaged in (False, True):
        with edit(filed) as draft:
            draft.delete("prediction", run="vanilla")
        if is_damaged:
            path.write_bytes(b"damaged")
        with s2rstore.open(filed) as store:
            assert "vanilla" not in {file.run for file in store.row_files["prediction"]}
        _insert_parquet(filed, content)
        assert is_damaged or row_files_of(filed) == before
    assert path.read_bytes() == content
    assert verify(filed) == []


def _insert_parquet(root: Path, content: bytes) -> None:
    copy = root.with_name("rows.parquet")
    copy.write_bytes(content)
    rows = duckdb.sql(f"SELECT * FROM '{copy}'").fetchall()
    names = [name for name in schema.BY_NAME["prediction"].column_names if name != "run"]
    columns = dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))
    with edit(root) as draft:
        draft.insert("prediction", {"run": ["vanilla"] * len(rows), **columns})
