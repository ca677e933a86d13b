"""Flat tables: every number that a view shows is one that `s2r sql` gives."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import pytest

from s2rtui.cli import main
from s2rtui.user_data.notebook import Notebook

NEW = "'train', 'validation'"


@pytest.fixture
def asked(tiny_store: Path, capsys):
    """Rows of a command on the tiny store."""

    def ask(*words: str) -> list[dict[str, Any]]:
        assert main([words[0], str(tiny_store), *words[1:], "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    return ask


def test_overview_is_of_what_is_new_to_the_model(asked) -> None:
    new = f"sim_split NOT IN ({NEW}) AND real_split NOT IN ({NEW})"
    expected = asked("sql", "SELECT run, avg(sim_accuracy) s, avg(real_accuracy) r, count(*) n "
                            f"FROM pair WHERE {new} GROUP BY run")  # fmt: skip
    shown = {row["run"]: row for row in asked("show", "overview")}
    assert len(shown) == len(expected) == 2
    for row in expected:
        found = shown[row["run"]]
        assert found["n"] == row["n"] == 8
        assert found["sim accuracy"] == pytest.approx(row["s"], rel=1e-12)
        assert found["real accuracy"] == pytest.approx(row["r"], rel=1e-12)
        assert found["real low"] <= found["real accuracy"] <= found["real high"]


def test_map_and_umap_list_the_selection(asked) -> None:
    where = "run = 'dataaug' AND real_error > 0.5 ORDER BY iid"
    poses = asked("sql", "SELECT iid, x, y, degrees(heading), sim_x, sim_y, degrees(sim_heading), "
                         "real_x, real_y, degrees(real_heading), shift "
                         f"FROM pair WHERE {where}")  # fmt: skip
    words = ("--select", "real.error > 0.5", "--run", "dataaug")
    assert _values(asked("show", "map", *words)) == _close(poses)
    apart = "sqrt((real_u - sim_u) ** 2 + (real_v - sim_v) ** 2)"
    points = asked("sql", f"SELECT iid, sim_u, sim_v, real_u, real_v, {apart} FROM pair "
                          f"WHERE {where}")  # fmt: skip
    assert _values(asked("show", "umap", *words)) == _close(points)


def test_orientation_counts_bins_of_five_degrees(asked) -> None:
    shown = asked("show", "orientation", "--select", "traj:a")
    assert len(shown) == 72
    for name, column in (("sim", "sim_heading"), ("truth", "heading"), ("real", "real_heading")):
        counted = asked("sql", f"SELECT 5 * floor(degrees({column}) / 5) b, count(*) n FROM pair "
                               "WHERE run = 'vanilla' AND trajectory = 'a' GROUP BY b")  # fmt: skip
        expected = {row["b"]: row["n"] for row in counted}
        assert {row["from"]: row[name] for row in shown if row[name]} == expected


def test_rooms_are_counted(asked) -> None:
    shown = {row["room"]: row for row in asked("show", "rooms", "--select", "seq:0..9")}
    truth = asked("sql", "SELECT room, count(*) n, count(*) FILTER (seq < 10) s FROM pair "
                         "WHERE run = 'vanilla' GROUP BY room")  # fmt: skip
    for row in truth:
        assert shown[row["room"]]["truth"] == row["s"]
        assert shown[row["room"]]["truth of all"] == row["n"]
    inside = "real_x BETWEEN 0 AND 5 AND real_y BETWEEN 0 AND 8 AND seq < 10 AND run = 'vanilla'"
    found = asked("sql", f"SELECT count(*) n FROM pair WHERE {inside}")
    assert shown["left hall"]["real"] == found[0]["n"]


def test_errors_are_counted_up_to_each_edge(asked) -> None:
    shown = asked("show", "errors", "--select", "all")
    for side in ("sim", "real"):
        total = 0
        for row in shown[:-1]:
            total += row[side]
            below = asked("sql", f"SELECT count(*) n FROM pair WHERE run = 'vanilla' "
                                 f"AND {side}_error < {row['to']!r}")  # fmt: skip
            assert total == below[0]["n"]
        assert total + shown[-1][side] == 40


def test_list_is_sorted_and_keeps_all_digits(asked) -> None:
    shown = asked("show", "list", "--select", "worst(7, gap)", "--sort", "gap")
    expected = asked("sql", "SELECT iid, gap, room, real_error, real_outlier o, "
                            "degrees(real_heading_error) turn FROM pair "
                            "WHERE run = 'vanilla' ORDER BY gap DESC, iid LIMIT 7")  # fmt: skip
    assert [row["iid"] for row in shown] == [row["iid"] for row in expected]
    for row, known in zip(shown, expected, strict=True):
        assert (row["gap"], row["room"]) == (known["gap"], known["room"])
        assert row["real.error"] == known["real_error"]
        assert row["real.heading_error"] == pytest.approx(known["turn"], rel=1e-12)
        assert row["real.outlier"] == known["o"]
    upwards = asked("show", "list", "--select", "worst(7, gap)", "--sort", "gap", "--ascending")
    assert upwards == shown[::-1]


def test_remarks_are_a_column(asked) -> None:
    book = Notebook("0" * 64)
    book.note(5, "glare")
    book.toggle_tag([5, 6], "door")
    shown = asked("show", "list", "--select", "ids(5..7)", "--sort", "iid", "--ascending")
    assert [row["remark"] for row in shown] == ["#door: glare", "#door", None]


def test_instance_has_numbers_and_notes(asked) -> None:
    rows = {row["what"]: row for row in asked("show", "instance", "--iid", "12")}
    known = asked("sql", "SELECT x, y, degrees(heading) h, real_x, real_error, sim_rank, "
                         "degrees(sim_heading_error) turn FROM pair WHERE run = 'vanilla' "
                         "AND iid = 12")[0]  # fmt: skip
    truth = rows["truth"]
    assert (truth["x"], truth["y"], truth["error"]) == (known["x"], known["y"], None)
    assert truth["heading"] == pytest.approx(known["h"], rel=1e-12)
    assert rows["real"]["x"] == known["real_x"]
    assert rows["real"]["error"] == known["real_error"]
    assert rows["sim"]["heading_error"] == pytest.approx(known["turn"], rel=1e-12)
    assert f"sim {known['sim_rank']}," in rows["ranks"]["note"]


def test_compare_counts_who_improved(asked) -> None:
    shown = {row["room"]: row for row in asked("show", "compare", "--with", "dataaug")}
    both = ("(SELECT a.room, a.real_error f, b.real_error s FROM pair a JOIN pair b USING (iid) "
            "WHERE a.run = 'vanilla' AND b.run = 'dataaug')")  # fmt: skip
    for where, name in (("true", "all"), ("room = 'right'", "right")):
        found = asked("sql", "SELECT count(*) n, avg(f) f, avg(s) s, avg(f - s) d, "
                             "count(*) FILTER (f - s > 0.05) better, "
                             f"count(*) FILTER (s - f > 0.05) worse FROM {both} WHERE {where}"
                             )[0]  # fmt: skip
        row = shown[name]
        assert (row["n"], row["improved"], row["worse"]) == (
            found["n"], found["better"], found["worse"],
        )  # fmt: skip
        assert row["equal"] == found["n"] - found["better"] - found["worse"]
        for mine, theirs in (("first mean", "f"), ("second mean", "s"), ("difference", "d")):
            assert row[mine] == pytest.approx(found[theirs], rel=1e-9)


def test_tables_round_and_csv_does_not(tiny_store: Path, capsys) -> None:
    words = ["show", str(tiny_store), "map", "--select", "ids(3)"]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert main([*words, "--format", "csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    value = rows[0]["real x"]
    assert len(value) > 12
    assert value not in printed
    assert f"{float(value):.4g}" in printed


@pytest.mark.parametrize(
    ("view", "told"),
    [
        ("overview", "vanilla: sim"), ("map", "6 of 40 instances"), ("umap", "in the median"),
        ("orientation", "truth"), ("rooms", "left hall"), ("errors", "real"),
        ("instance", "real error"), ("list", "by real.error"), ("compare", "dataaug is better"),
    ],
)  # fmt: skip
def test_every_view_has_words(tiny_store: Path, view: str, told: str, capsys) -> None:
    assert main(["show", str(tiny_store), view, "--select", "worst15", "--words"]) == 0
    said = capsys.readouterr().out
    assert told in said
    assert said.count("\n") == 1
    assert main(["show", str(tiny_store), view, "--select", "none", "--words"]) == 0
    assert "nan" not in capsys.readouterr().out


def _values(rows: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    return [tuple(row.values()) for row in rows]


def _close(rows: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    assert rows
    return [
        tuple(v if isinstance(v, int) else pytest.approx(v, rel=1e-12, abs=1e-12) for v in row)
        for row in _values(rows)
        if not any(isinstance(v, float) and math.isnan(v) for v in row)
    ]
