"""Selections as rows: what is selected, with what, and what it was true of."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import duckdb
import numpy as np
import pytest

import s2rstore
from s2rstore.language import evaluation
from s2rtui.cli import main
from s2rtui.export.rows.formats import write_rows
from s2rtui.user_data.notebook import Notebook, SavedSelection

PLAIN = (
    "iid,trajectory,seq,x,y,heading,room,sim_error,real_error,gap,sim_heading_error,"
    "real_heading_error"
)


@pytest.fixture
def book() -> Notebook:
    """A notebook of the tiny data set with a selection and a tag."""
    made = Notebook("0" * 64)
    made.save("bad", SavedSelection("worst15", 1, "vanilla", 6))
    made.toggle_tag([3, 8], "door")
    made.note(8, 'a "quoted", note')
    return made


def query(store: Path, capsys, *words: str) -> str:
    assert main(["query", str(store), *words]) == 0
    return capsys.readouterr().out


def test_plain_output_has_rows_alone(tiny_store: Path, capsys) -> None:
    lines = query(tiny_store, capsys, "ids(2..4)", "--format", "csv").splitlines()
    assert lines[0] == PLAIN
    assert [line.split(",")[0] for line in lines[1:]] == ["2", "3", "4"]
    assert len(json.loads(query(tiny_store, capsys, "ids(2..4)", "--json"))) == 3


def test_csv_begins_with_what_it_was_evaluated_on(tiny_store: Path, capsys) -> None:
    words = ("worst15 & room:right", "--run", "dataaug", "--with-expression", "--format", "csv")
    lines = query(tiny_store, capsys, *words).splitlines()
    told = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# "))
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    with s2rstore.open(tiny_store) as store:
        chosen = np.flatnonzero(evaluation.select(store, "worst15 & room:right", "dataaug"))
        assert told == {
            "expression": "worst15 & room:right", "run": "dataaug",
            "generation": str(store.generation), "dataset": "0" * 64, "dataset_name": "tiny",
            "count": str(chosen.size),
        }  # fmt: skip
    assert [int(row["iid"]) for row in rows] == chosen.tolist()


def test_json_and_parquet_hold_the_same(tiny_store: Path, tmp_path: Path, capsys, book) -> None:
    words = ("@bad | @door", "--trajectory", "a", "--with-expression")
    told = json.loads(query(tiny_store, capsys, *words, "--json"))
    instances = told.pop("instances")
    assert told["expression"] == "@bad | @door"
    assert told["expanded"] == "worst15 | ids(3, 8)"
    assert told["trajectories"] == ["a"]
    assert told["count"] == len(instances) > 2
    out = tmp_path / "o'ut.parquet"
    query(tiny_store, capsys, *words, "--format", "parquet", "--out", str(out))
    with duckdb.connect() as connection:
        name = str(out).replace("'", "''")
        kept = connection.execute(
            f"SELECT decode(key), decode(value) FROM parquet_kv_metadata('{name}')"
        ).fetchall()
        found = connection.execute(f"SELECT * FROM '{name}'")
        names = [column[0] for column in found.description]
        rows = [dict(zip(names, row, strict=True)) for row in found.fetchall()]
    assert rows == instances
    assert {
        k: json.loads(v) if v[0] in "[0123456789" and k != "dataset" else v for k, v in kept
    } == {key: list(value) if isinstance(value, tuple) else value for key, value in told.items()}


def test_the_expanded_expression_selects_the_same(tiny_store: Path, capsys, book) -> None:
    told = json.loads(query(tiny_store, capsys, "@bad - @door", "--with-expression", "--json"))
    again = json.loads(query(tiny_store, capsys, told["expanded"], "--json"))
    assert again == told["instances"]
    count = query(tiny_store, capsys, "@bad - @door", "--count")
    assert int(count) == told["count"]


def test_columns_are_the_language_s_fields(tiny_store: Path, capsys, book) -> None:
    wanted = "iid,traj,real.room,real.heading,real.outlier,sim.rank,sim.split,gap,tags,note"
    words = ("ids(7..8)", "--columns", wanted, "--json", "--run", "dataaug")
    rows = json.loads(query(tiny_store, capsys, *words))
    assert list(rows[0]) == wanted.split(",")
    assert [row["tags"] for row in rows] == [None, "door"]
    assert rows[1]["note"] == 'a "quoted", note'
    with s2rstore.open(tiny_store) as store:
        columns = store.run_columns("dataaug")
        assert rows[0]["real.outlier"] == columns.real.outlier[7]
        assert rows[0]["sim.rank"] == columns.sim.rank[7]
        assert rows[0]["real.heading"] == pytest.approx(np.degrees(columns.real.heading[7]))
        assert rows[0]["sim.split"] == "train"
    outliers = json.loads(query(tiny_store, capsys, "real.outlier > 1.5", "--columns",
                                "real.outlier", "--json"))  # fmt: skip
    assert outliers
    assert all(row["real.outlier"] > 1.5 for row in outliers)


def test_a_predicted_room_that_is_none_is_missing(tiny_store: Path, capsys) -> None:
    rows = json.loads(query(tiny_store, capsys, "all", "--columns", "real.room,real.x", "--json"))
    outside = [row for row in rows if not 0 <= row["real.x"] <= 10]
    assert outside
    assert {row["real.room"] for row in outside} == {None}


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["all", "--columns", "iid,rubbish"], "rubbish: must be one of iid"),
        (["all", "--columns", "iid,iid", "--json"], "twice"),
        (["@nothing"], "saved selection"),
    ],
)
def test_a_wrong_request_says_what_there_is(
    tiny_store: Path, words: list[str], told: str, capsys
) -> None:
    assert main(["query", str(tiny_store), *words]) == 2
    assert told in capsys.readouterr().err


def test_a_fact_stays_on_its_line(tmp_path: Path) -> None:
    target = tmp_path / "a.csv"
    write_rows(target, ["a"], [(1,)], {"expression": 'room:"x\ny\x1b[2J"'})
    lines = target.read_text().splitlines()
    assert lines[0].startswith("# expression: ")
    assert "\x1b" not in lines[0]
    assert lines[1:] == ["a", "1"]


def test_many_rows_are_written_at_once(tmp_path: Path) -> None:
    rows = [(n, n / 3 if n % 2 else None, None if n % 5 else "é") for n in range(50_000)]
    write_rows(tmp_path / "a.parquet", ["n", "x", "t"], rows)
    with duckdb.connect() as connection:
        kept = connection.execute(f"SELECT * FROM '{tmp_path}/a.parquet' ORDER BY n").fetchall()
    assert kept == rows


def test_no_rows_are_a_file_too(tmp_path: Path) -> None:
    write_rows(tmp_path / "a.parquet", ["n"], [])
    with duckdb.connect() as connection:
        assert connection.execute(f"SELECT * FROM '{tmp_path}/a.parquet'").fetchall() == []
