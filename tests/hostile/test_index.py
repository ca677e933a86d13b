"""A manipulated index runs no code, reads no other file and is rejected in one line."""

import duckdb
import pytest

import s2rstore
from bench.edited_index import edited
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.index.transaction import edit
from s2rtui.cli import main
from tests.support.copies import copy_store

CODE_STATEMENTS = {
    "view that reads a file": (
        "DROP TABLE provenance",
        "CREATE VIEW provenance AS SELECT 'x' AS what, filename AS key, content AS value "
        "FROM read_text('/etc/passwd')",
    ),
    "view that lists folders": (
        "DROP TABLE provenance",
        "CREATE VIEW provenance AS SELECT 'x' AS what, 'x' AS key, file AS value FROM glob('/*')",
    ),
    "view that never ends": (
        "DROP VIEW pair",
        "DROP TABLE instance",
        "CREATE VIEW instance AS SELECT range::INTEGER AS iid, 'a' AS trajectory, 0 AS seq, "
        "0.0 AS x, 0.0 AS y, 0.0 AS heading, NULL AS room, 0.0 AS curvature, NULL AS odom_x, "
        "NULL AS odom_y, NULL AS odom_heading, NULL AS timestamp FROM range(10000000000)",
    ),
    "extra view": ("CREATE VIEW rooms AS SELECT 1 AS one",),
    "macro in place of a function": ("CREATE MACRO sqrt(x) AS 0.0",),
    "macro in place of the catalog": (
        "CREATE MACRO duckdb_functions() AS TABLE SELECT 'x' AS function_name, true AS internal",
        "CREATE MACRO sqrt(x) AS 0.0",
    ),
    "macro in another schema": ("CREATE SCHEMA s", "CREATE MACRO s.f(x) AS x"),
    "pair with another formula": (
        "CREATE OR REPLACE VIEW pair AS SELECT s.run, s.iid, 0.0 AS gap FROM prediction s",
    ),
    "type": ("CREATE TYPE side AS ENUM ('sim', 'real')",),
    "sequence": ("CREATE SEQUENCE numbers",),
    "default that is computed": (
        "ALTER TABLE provenance ALTER value SET DEFAULT (random()::VARCHAR)",
    ),
    "rows that fill the memory": (
        "DELETE FROM instance",
        "INSERT INTO instance (iid, trajectory) SELECT 0, 'a' FROM range(10000000)",
    ),
}


@pytest.mark.parametrize("statements", CODE_STATEMENTS.values(), ids=CODE_STATEMENTS.keys())
def test_an_index_with_code_is_rejected_and_never_copied(store_copy, statements, s2r):
    index = edited(store_copy, statements)
    with pytest.raises(RequestError, match=layout.INDEX):
        s2rstore.open(store_copy)
    with pytest.raises(RequestError), edit(store_copy):
        pytest.fail("a generation was begun from a hostile index")
    add_command = ["run", "add", "more", "--model", "vanilla", "--store", str(store_copy)]
    for command in (add_command, ["sql", str(store_copy), "SELECT 1"]):
        output = s2r(*command).checked(2)
        assert output.out == ""
        assert output.err.count("\n") == 1
        assert "root:" not in output.err
    assert list((store_copy / layout.INDEX).iterdir()) == [
        path for path in (store_copy / layout.INDEX).iterdir() if path.name <= index.name
    ]


def test_a_write_ahead_log_beside_the_index_is_rejected(store_copy):
    current = layout.read_current(store_copy)
    index = store_copy / current.index
    copy = store_copy.parent / index.name
    copy.write_bytes(index.read_bytes())
    connection = duckdb.connect(str(copy), config={"checkpoint_threshold": "1TB"})
    connection.execute("PRAGMA disable_checkpoint_on_shutdown")
    connection.execute("UPDATE prediction SET x = 0")
    log = copy.with_name(f"{copy.name}.wal").read_bytes()
    connection.close()
    index.with_name(f"{index.name}.wal").write_bytes(log)
    with pytest.raises(RequestError, match="write-ahead log"):
        s2rstore.open(store_copy)


INVALID_ROWS = {
    "adjustments that are no JSON": "UPDATE run SET sim_adjustments = '[{' WHERE run = 'vanilla'",
    "adjustments that are no list": "UPDATE run SET real_adjustments = '{}'",
    "adjustments that are NULL": "UPDATE run SET real_adjustments = NULL",
    "adjustments without a name": "UPDATE run SET real_adjustments = '[1]'",
    "a bound that is NaN": "UPDATE dataset SET bounds_y1 = 'NaN'",
    "bounds without a size": "UPDATE dataset SET bounds_x1 = bounds_x0",
    "a scale of 0": "UPDATE dataset SET accuracy_scale = 0",
    "thresholds that are no pairs": "UPDATE dataset SET recall_thresholds = '[0.25, 2]'",
    "thresholds that descend": "UPDATE dataset SET recall_thresholds = '[[1, 10], [0.5, 20]]'",
    "frames of a million rows": "UPDATE dataset SET frame_height = 1000000",
    "a name that is NULL": "UPDATE dataset SET name = NULL",
    "a hash that is a path": "UPDATE dataset SET hash = '../../../../tmp/x'",
    "weights that are a path": "UPDATE model SET sha256 = '../secret'",
    "two data sets": "INSERT INTO dataset SELECT * FROM dataset",
    "two rooms of one position": "UPDATE room SET position = 0",
    "a room without a position": "UPDATE room SET position = NULL WHERE room = 'right'",
    "a room of a million characters": "UPDATE room SET room = repeat('a', 1000000)",
    "a trajectory that is a path": "UPDATE trajectory SET trajectory = '../x'",
    "a domain that is a path": "UPDATE domain SET domain = '../x' WHERE domain = 'sim'",
    "a kind of domain": "UPDATE domain SET kind = 'other'",
    "a focal length of 0": "UPDATE domain SET rgb_fx = 0",
    "sources that are no JSON": "UPDATE domain SET source = 'declared'",
    "a convention that is no JSON": "UPDATE model SET convention = 'map'",
    "an input without channels": "UPDATE model SET input = '{}'",
    "a key that is a path": "UPDATE run SET key = '../../x'",
    "a table that is missing": "DROP VIEW pair; DROP TABLE room",
    "a column that is missing": "DROP VIEW pair; ALTER TABLE prediction DROP COLUMN error",
    "a column of another type": "ALTER TABLE provenance ALTER value TYPE INTEGER[] USING [1]",
}


@pytest.mark.parametrize("statements", INVALID_ROWS.values(), ids=INVALID_ROWS.keys())
def test_invalid_rows_are_rejected_in_one_line(store_copy, statements, s2r):
    edited(store_copy, statements.split("; "))
    s2r("sql", store_copy, "SELECT 1").assert_refused()
    assert main(["verify", str(store_copy)]) == 1


EXCESSIVE_ROWS = {
    "rooms": "INSERT INTO room SELECT 'r' || i, i + 2, i, 0, i + 1, 1 FROM range(5000) t(i)",
    "runs": "INSERT INTO run SELECT run.* FROM run, range(10000)",
}


@pytest.mark.parametrize("statement", EXCESSIVE_ROWS.values(), ids=EXCESSIVE_ROWS.keys())
def test_excessive_row_counts_are_rejected_in_one_line(store_copy, statement, s2r):
    edited(store_copy, [statement])
    s2r("runs", store_copy).assert_refused("rows, at most")


INCONSISTENT_TRAJECTORIES = {
    "an instance of another trajectory": "UPDATE instance SET trajectory = 'b' WHERE iid = 3",
    "an instance that ends another trajectory":
        "UPDATE instance SET trajectory = 'b' WHERE iid = 24",
    "an instance of no trajectory": "UPDATE instance SET trajectory = NULL WHERE iid = 3",
}  # fmt: skip


@pytest.mark.parametrize(
    "statement", INCONSISTENT_TRAJECTORIES.values(), ids=INCONSISTENT_TRAJECTORIES.keys()
)
def test_frames_of_inconsistent_trajectories_are_rejected(store_copy, statement):
    edited(store_copy, [statement])
    assert main(["verify", str(store_copy)]) == 1
    with s2rstore.open(store_copy) as store, pytest.raises(RequestError, match="verify"):
        store.frame("sim", 30)


def test_verify_detects_dangling_names_and_parts_of_poses(store_copy, s2r):
    edited(store_copy, ["UPDATE instance SET room = 'nowhere' WHERE iid = 3",
                        "UPDATE run SET sim_domain = 'nowhere' WHERE run = 'vanilla'",
                        "UPDATE prediction SET heading = NULL WHERE iid = 3",
                        "UPDATE prediction SET split = NULL WHERE iid = 4"])  # fmt: skip
    found = s2r("verify", store_copy).checked(1)
    for word in ("room", "domain", "without the others", "without a split"):
        assert word in found.out + found.err


INVALID_ARRAYS = {
    "a shape that is no JSON": "UPDATE zarr_array SET shape = '[40'",
    "a shape of 10^18 rows": "UPDATE zarr_array SET shape = '[1000000000000000000]'",
    "axes of another number": "UPDATE zarr_array SET axes = '[]'",
    "a scale that is NaN": "UPDATE zarr_array SET scale = 'NaN'",
    "a kind with an escape sequence": "UPDATE zarr_array SET kind = chr(27) || ']52;c;eA=='",
    "a path that leads out": "UPDATE zarr_array SET path = '../../../etc'",
    "a side that is none": "UPDATE zarr_array SET side = 'left'",
}


@pytest.mark.parametrize("statement", INVALID_ARRAYS.values(), ids=INVALID_ARRAYS.keys())
def test_invalid_array_records_are_rejected_in_one_line(store_copy, statement, tmp_path, s2r):
    edited(store_copy, [statement])
    out = tmp_path / "out.png"
    arguments = ["export", str(store_copy), "--view", "instance", "--heat", "activation"]
    output = s2r(*arguments, "--out", out).checked(2)
    assert output.err.count("\n") == 1
    assert "\x1b" not in output.err
    assert not out.exists()


@pytest.mark.parametrize("name", ["md:x", "~", "a'b", "[*]"])
def test_a_store_may_have_an_unusual_name(tiny_store, tmp_path, name, monkeypatch, s2r):
    copy_store(tiny_store, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    assert main(["verify", name]) == 0
    assert main(["run", "add", "more", "--model", "vanilla", "--store", name]) == 0
    assert (
        s2r("sql", name, "SELECT run FROM run ORDER BY run", "--format", "csv").printed
        == "run\ndataaug\nmore\nvanilla\n"
    )
