"""The show command: every number of a view equals the result of an SQL query."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from s2rstore.index.transaction import edit
from s2rtui.cli import main
from tests.support import tiny
from tests.support.refusals import RunCommand
from tests.support.small_figures import draw_small_figures

TRAINING_SPLITS = "'train', 'validation'"


@pytest.fixture
def query(tiny_store: Path, s2r: RunCommand) -> Callable[..., list[dict[str, Any]]]:
    """A function that returns the rows of a command on the tiny store."""
    return lambda command, *words: s2r(command, tiny_store, *words, "--json").json


def test_the_overview_uses_only_held_out_instances(tmp_path, s2r):
    path = str(tiny.build(tmp_path / "s.s2r", trained=tiny.RUNS))
    new = f"sim_split NOT IN ({TRAINING_SPLITS}) AND real_split NOT IN ({TRAINING_SPLITS})"
    text = "SELECT run, avg(sim_accuracy) s, avg(real_accuracy) r, count(*) n FROM pair"
    expected = s2r("sql", path, f"{text} WHERE {new} GROUP BY run", "--json").json
    shown = {row["run"]: row for row in s2r("show", path, "overview", "--json").json}
    assert len(shown) == len(expected) == 2
    for row in expected:
        computed = shown[row["run"]]
        assert computed["n"] == row["n"] == 8
        assert computed["sim accuracy"] == pytest.approx(row["s"], rel=1e-12)
        assert computed["real accuracy"] == pytest.approx(row["r"], rel=1e-12)
        assert computed["real low"] is None


def test_map_and_umap_list_the_selection(query):
    where = "run = 'dataaug' AND real_error_m > 0.5 ORDER BY iid"
    poses = query("sql", "SELECT iid, x_m, y_m, degrees(heading_rad), sim_x_m, sim_y_m, "
                         "degrees(sim_heading_rad), real_x_m, real_y_m, "
                         "degrees(real_heading_rad), shift_m "
                         f"FROM pair WHERE {where}")  # fmt: skip
    arguments = ("--select", "real.error > 0.5", "--run", "dataaug")
    assert _values(query("show", "map", *arguments)) == _approximately(poses)
    apart = "sqrt((real_u - sim_u) ** 2 + (real_v - sim_v) ** 2)"
    points = query("sql", f"SELECT iid, sim_u, sim_v, real_u, real_v, {apart} FROM pair "
                          f"WHERE {where}")  # fmt: skip
    assert _values(query("show", "umap", *arguments)) == _approximately(points)


def test_orientation_counts_bins_of_five_degrees(query):
    shown = query("show", "orientation", "--select", "traj:a")
    assert len(shown) == 72
    for name, column in (("sim", "sim_heading"), ("truth", "heading"), ("real", "real_heading")):
        counted = query("sql", f"SELECT 5 * floor(degrees({column}_rad) / 5) b, count(*) n "
                               "FROM pair WHERE run = 'vanilla' AND trajectory = 'a' "
                               "GROUP BY b")  # fmt: skip
        expected = {row["b"]: row["n"] for row in counted}
        assert {row["from_deg"]: row[name] for row in shown if row[name]} == expected


def test_rooms_are_counted(query):
    rows = query("show", "rooms", "--group-by", "counts", "--select", "seq:0..9")
    shown = {row["room"]: row for row in rows}
    truth = query("sql", "SELECT room, count(*) n, count(*) FILTER (seq < 10) s FROM pair "
                         "WHERE run = 'vanilla' GROUP BY room")  # fmt: skip
    for row in truth:
        assert shown[row["room"]]["truth"] == row["s"]
        assert shown[row["room"]]["truth of all"] == row["n"]
    inside = "real_x_m BETWEEN 0 AND 5 AND real_y_m BETWEEN 0 AND 8 AND seq < 10"
    computed = query("sql", f"SELECT count(*) n FROM pair WHERE {inside} AND run = 'vanilla'")
    assert shown["left hall"]["real"] == computed[0]["n"]


def test_error_bins_add_up_to_the_cumulative_counts(query):
    shown = query("show", "errors", "--select", "all")
    stored = query(
        "sql", "SELECT sim_error_m sim, real_error_m real FROM pair WHERE run = 'vanilla'"
    )
    for side in ("sim", "real"):
        total = 0
        for row in shown[:-1]:
            total += row[side]
            assert total == sum(pair[side] < row["to_m"] for pair in stored)
        assert total + shown[-1][side] == 40


def test_the_list_is_sorted_and_has_full_precision(query):
    shown = query("show", "list", "--select", "worst(7, gap)", "--sort", "gap")
    expected = query("sql", "SELECT iid, gap_m, room, real_error_m, real_outlier o, "
                            "degrees(real_heading_error_rad) turn FROM pair "
                            "WHERE run = 'vanilla' ORDER BY gap_m DESC, iid LIMIT 7")  # fmt: skip
    assert [row["iid"] for row in shown] == [row["iid"] for row in expected]
    for row, stored in zip(shown, expected, strict=True):
        assert (row["gap_m"], row["room"]) == (stored["gap_m"], stored["room"])
        assert row["real_error_m"] == stored["real_error_m"]
        assert row["real_heading_error_deg"] == pytest.approx(stored["turn"], rel=1e-12)
        assert row["real_outlier"] == stored["o"]
    ascending = query("show", "list", "--select", "worst(7, gap)", "--sort", "gap", "--ascending")
    assert ascending == shown[::-1]


def test_instance_has_numbers_and_notes(query):
    rows = {row["what"]: row for row in query("show", "instance", "--iid", "12")}
    stored = query("sql", "SELECT x_m, y_m, degrees(heading_rad) h, real_x_m, real_error_m, "
                         "sim_rank, degrees(sim_heading_error_rad) turn FROM pair "
                         "WHERE run = 'vanilla' AND iid = 12")[0]  # fmt: skip
    truth = rows["truth"]
    assert (truth["x_m"], truth["y_m"], truth["error_m"]) == (stored["x_m"], stored["y_m"], None)
    assert truth["heading_deg"] == pytest.approx(stored["h"], rel=1e-12)
    assert rows["real"]["x_m"] == stored["real_x_m"]
    assert rows["real"]["error_m"] == stored["real_error_m"]
    assert rows["sim"]["heading_error_deg"] == pytest.approx(stored["turn"], rel=1e-12)
    assert f"sim {stored['sim_rank']}," in rows["ranks"]["note"]


def test_compare_counts_improved_instances(query):
    shown = {row["room"]: row for row in query("show", "compare", "--with", "dataaug")}
    both = ("(SELECT a.room, a.real_error_m f, b.real_error_m s FROM pair a "
            "JOIN pair b USING (iid) WHERE a.run = 'vanilla' AND b.run = 'dataaug')")  # fmt: skip
    for where, name in (("true", "all"), ("room = 'right'", "right")):
        computed = query("sql", "SELECT count(*) n, median(f) f, median(s) s, median(s - f) d, "
                             "avg(f) fm, avg(s) sm, "
                             "count(*) FILTER (f - s > 0.05) better, "
                             f"count(*) FILTER (s - f > 0.05) worse FROM {both} WHERE {where}"
                             )[0]  # fmt: skip
        row = shown[name]
        assert (row["n"], row["improved"], row["worse"]) == (
            computed["n"], computed["better"], computed["worse"],
        )  # fmt: skip
        assert row["equal"] == computed["n"] - computed["better"] - computed["worse"]
        names = ("first_median_m", "second_median_m", "median_change_m", "first_mean_m",
                 "second_mean_m")  # fmt: skip
        for name, column in zip(names, ("f", "s", "d", "fm", "sm"), strict=True):
            assert row[name] == pytest.approx(computed[column], rel=1e-9)


def test_the_scatter_view_counts_quadrants(query):
    shown = {row["quadrant"]: row for row in query("show", "scatter", "--select", "gap > 0")}
    assert shown["all"]["instances"] == 40
    for row in shown.values():
        assert row["instances"] == len(query("query", row["expression"]))
        assert row["selected"] == len(query("query", f"({row['expression']}) & gap > 0"))


def test_tables_are_rounded_and_csv_is_not(tiny_store, s2r):
    arguments = ["show", str(tiny_store), "map", "--select", "ids(3)"]
    printed = s2r(*arguments).printed
    rows = s2r(*arguments, "--format", "csv").rows
    value = rows[0]["real_x_m"]
    assert len(value) > 12
    assert value not in printed
    assert f"{float(value):.4g}" in printed


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        ("overview", "vanilla: sim"), ("map", "6 of 40 instances"), ("umap", "in the median"),
        ("orientation", "truth"), ("rooms", "left hall"), ("errors", "real"),
        ("instance", "real error"), ("list", "by real.error"), ("compare", "dataaug is better"),
        ("scatter", "worst 15 % in sim"),
    ],
)  # fmt: skip
def test_every_view_has_a_summary(tiny_store, view, expected, s2r):
    summary = s2r("show", tiny_store, view, "--select", "worst15", "--words").printed
    assert expected in summary
    assert summary.count("\n") == 1
    assert "nan" not in s2r("show", tiny_store, view, "--select", "none", "--words").printed


def _values(rows: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    return [tuple(row.values()) for row in rows]


def _approximately(rows: list[dict[str, Any]]) -> list[tuple[Any, ...]]:
    assert rows
    return [
        tuple(v if isinstance(v, int) else pytest.approx(v, rel=1e-12, abs=1e-12) for v in row)
        for row in _values(rows)
        if not any(isinstance(v, float) and math.isnan(v) for v in row)
    ]


def test_open_bounds_are_marked(tmp_path, s2r, monkeypatch):
    """All changes lie below 0, but three stretches of them say little: this is not evident."""
    path = tiny.build(tmp_path / "few.s2r", 30)
    with edit(path) as draft:
        for run, error in (("vanilla", "3"), ("dataaug", "[2.9, 2.7, 2.1][1 + iid // 10]")):
            where = f"WHERE run = '{run}' AND side = 'real'"
            draft.rows(f"UPDATE prediction SET error = {error} {where}")
    command = ["show", str(path), "compare", "--run", "vanilla", "--with", "dataaug"]
    *_, total = s2r(*command).lines
    assert " no " in total
    assert "  <-0.9  " in total
    assert "  >-0.1  " in total
    row = s2r(*command, "--json").json[-1]
    assert (row["low_m"], row["high_m"]) == (pytest.approx(-0.9), pytest.approx(-0.1))
    assert row["bounds"] == "<-0.90 to >-0.10"
    draw_small_figures(monkeypatch)
    page = tmp_path / "page.html"
    options = ["--run", "vanilla", "--with", "dataaug", "--select", "all", "--out", str(page)]
    assert main(["report", str(path), *options]) == 0
    assert "&lt;−0.90" in page.read_text()
