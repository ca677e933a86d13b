"""The query command: rows, formats, columns and metadata, also without a computed run."""

import csv
import json
from pathlib import Path

import duckdb
import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rtui.cli import main
from s2rtui.export.rows import write_rows
from s2rtui.user_data.notebook import Notebook, SavedSelection
from tests.support import pairs
from tests.support.copies import copy_store

DEFAULT_HEADER = (
    "iid,trajectory,seq,x_m,y_m,heading_deg,room,sim_error_m,real_error_m,gap_m,"
    "sim_heading_error_deg,real_heading_error_deg"
)


@pytest.fixture
def notebook() -> Notebook:
    """A notebook of the tiny data set with a selection and a tag."""
    saved = Notebook("0" * 64)
    saved.save("bad", SavedSelection("worst15", 1, "vanilla", 6))
    saved.toggle_tag([3, 8], "door")
    saved.note(8, 'a "quoted", note')
    return saved


def test_plain_output_contains_only_rows(tiny_store, s2r):
    arguments = ("ids(2..4)", "--format", "csv")
    lines = s2r("query", tiny_store, *arguments).lines
    assert lines[0] == DEFAULT_HEADER
    assert [line.split(",")[0] for line in lines[1:]] == ["2", "3", "4"]
    assert len(s2r("query", tiny_store, "ids(2..4)", "--json").json) == 3


def test_csv_starts_with_the_evaluation_metadata(tiny_store, s2r):
    arguments = ("worst15 & room:right", "--run", "dataaug", "--with-expression", "--format", "csv")
    lines = s2r("query", tiny_store, *arguments).lines
    metadata = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# "))
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    with s2rstore.open(tiny_store) as store:
        selected = np.flatnonzero(evaluation.select(store, "worst15 & room:right", "dataaug"))
        assert metadata == {
            "expression": "worst15 & room:right", "run": "dataaug",
            "generation": str(store.generation), "dataset": "0" * 64, "dataset_name": "tiny",
            "count": str(selected.size),
        }  # fmt: skip
    assert [int(row["iid"]) for row in rows] == selected.tolist()


def test_json_and_parquet_contain_the_same_rows(tiny_store, tmp_path, s2r, notebook):
    arguments = ("@bad | @door", "--trajectory", "a", "--with-expression")
    metadata = s2r("query", tiny_store, *arguments, "--json").json
    instances = metadata.pop("instances")
    assert metadata["expression"] == "@bad | @door"
    assert metadata["expanded"] == "worst15 | ids(3, 8)"
    assert metadata["trajectories"] == ["a"]
    assert metadata["count"] == len(instances) > 2
    out = tmp_path / "o'ut.parquet"
    s2r("query", tiny_store, *arguments, "--format", "parquet", "--out", out).checked()
    with duckdb.connect() as connection:
        name = str(out).replace("'", "''")
        facts = "SELECT decode(key), decode(value) FROM parquet_kv_metadata"
        stored = dict(connection.execute(f"{facts}('{name}')").fetchall())
        result = connection.execute(f"SELECT * FROM '{name}'")
        names = [column[0] for column in result.description]
        rows = [dict(zip(names, row, strict=True)) for row in result.fetchall()]
    assert rows == instances
    assert stored == {k: v if isinstance(v, str) else json.dumps(v) for k, v in metadata.items()}


def test_columns_are_the_fields_of_the_selection_language(tiny_store, s2r, notebook):
    names = "iid,traj,real.room,real.heading,real.outlier,sim.rank,sim.split,gap,tags,note"
    arguments = ("ids(7..8)", "--columns", names, "--json", "--run", "dataaug")
    rows = s2r("query", tiny_store, *arguments).json
    assert list(rows[0]) == names.split(",")
    assert [row["tags"] for row in rows] == [None, "door"]
    assert rows[1]["note"] == 'a "quoted", note'
    with s2rstore.open(tiny_store) as store:
        columns = store.run_columns("dataaug")
        assert rows[0]["real.outlier"] == columns.real.outlier[7]
        assert rows[0]["sim.rank"] == columns.sim.rank[7]
        assert rows[0]["real.heading"] == pytest.approx(np.degrees(columns.real.heading[7]))
        assert rows[0]["sim.split"] == "test"
    columns = ("--columns", "real.outlier", "--json")
    outliers = s2r("query", tiny_store, "real.outlier > 1.5", *columns).json
    assert outliers
    assert all(row["real.outlier"] > 1.5 for row in outliers)


def test_a_prediction_outside_all_rooms_has_no_room(tiny_store, s2r):
    rows = s2r("query", tiny_store, "all", "--columns", "real.room,real.x", "--json").json
    outside = [row for row in rows if not 0 <= row["real.x"] <= 10]
    assert outside
    assert {row["real.room"] for row in outside} == {None}


def test_metadata_values_stay_on_one_line(tmp_path):
    target = tmp_path / "a.csv"
    write_rows(target, ["a"], [(1,)], {"expression": 'room:"x\ny\x1b[2J"'})
    lines = target.read_text().splitlines()
    assert lines[0].startswith("# expression: ")
    assert "\x1b" not in lines[0]
    assert lines[1:] == ["a", "1"]


def test_many_rows_are_written_to_parquet(tmp_path):
    rows = [(n, n / 3 if n % 2 else None, None if n % 5 else "é") for n in range(50_000)]
    write_rows(tmp_path / "a.parquet", ["n", "x", "t"], rows)
    with duckdb.connect() as connection:
        stored = connection.execute(f"SELECT * FROM '{tmp_path}/a.parquet' ORDER BY n").fetchall()
    assert stored == rows


def test_an_empty_result_suggests_expressions_that_select_something(tiny_store, s2r):
    empty = "worst(1, sim.error) & best(1, sim.error)"
    for options in (["--count"], ["--format", "csv"]):
        lines = s2r("query", tiny_store, empty, *options).checked().err.splitlines()
        suggestions = [line for line in lines if line.startswith("nothing is selected; ")]
        assert 1 <= len(suggestions) <= 2
        for line in suggestions:
            expression, count = line.removeprefix("nothing is selected; ").split(" would give ")
            assert s2r("query", tiny_store, expression, "--count").printed.strip() == count != "0"
    assert "nothing is selected" not in s2r("query", tiny_store, "ids(3)").checked().err


def test_runs_without_shares_of_the_gap_are_named(tiny_store, tmp_path, s2r):
    path = copy_store(tiny_store, tmp_path / "own.s2r")
    captured = s2r("query", path, "share.lighting > -99", "--run", "vanilla", "--count").checked()
    assert int(captured.out) > 0
    assert "shares" not in captured.err
    with edit(path) as draft:
        draft.delete("zarr_array", kind="gap_shares", run="dataaug")
    words = ["query", str(path), 'all & run("dataaug").share.lighting > 1', "--run", "vanilla"]
    assert (
        "run dataaug has no shares of the gap; `s2r precompute"
        in s2r(*words, "--count").checked().err
    )
    assert s2r("show", path, "shares", "--run", "dataaug", "--json").json == []


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """12 pairs in two rooms; no test modifies it."""
    root = tmp_path_factory.mktemp("unpredicted")
    path, manifest = root / "s.s2r", pairs.manifest(root / "data")
    assert main(["ingest", "csv", str(manifest), "--store", str(path), "--size", "16"]) == 0
    return path


def test_expressions_of_the_ground_truth_work(store, s2r):
    rows = s2r("query", store, "all", "--format", "csv").rows
    assert len(rows) == 12
    assert list(rows[0]) == ["iid", "trajectory", "seq", "x_m", "y_m", "heading_deg", "room"]
    expected = [row["iid"] for row in rows if row["room"] == "west" and row["trajectory"] == "a"]
    command = ["query", str(store), "room:west & traj:a & x < 100 & (straight | curved)"]
    found = s2r(*command, "--columns", "iid,x,tags", "--format", "csv").rows
    assert expected
    assert [row["iid"] for row in found] == expected
    assert s2r(*command, "--count").printed.strip() == str(len(expected))


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        (["worst15"], "real.error"),
        (["x > 1 & sim.error > 2"], "sim.error"),
        (["like(3, 2)"], "like"),
        (["sim.room:west"], "sim.room"),
        (["all", "--columns", "iid,gap"], "--columns gap"),
        (["all", "--columns", "iid,real.room"], "--columns real.room"),
    ],
)
def test_fields_of_predictions_need_a_run(store, s2r, arguments, field):
    s2r("query", store, *arguments).assert_refused(
        f"{field}", "needs predictions: no run; train a model (`s2r train`)", "`s2r run import`"
    )


def test_precompute_and_unknown_runs_name_both_ways(store, s2r):
    s2r("precompute", store).assert_refused("`s2r run import`")
    s2r("query", store, "all", "--run", "mine").assert_refused("run 'mine': not in")


def test_an_empty_result_is_a_valid_parquet_file(tmp_path):
    write_rows(tmp_path / "a.parquet", ["n"], [])
    with duckdb.connect() as connection:
        assert connection.execute(f"SELECT * FROM '{tmp_path}/a.parquet'").fetchall() == []
