"""Findings and grouped errors: independent figures, exact expressions, honest silence."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.findings import Finding, FindingReport, costliest_factor, find_all, run_differences
from s2rstore.findings import gap_drift as DRIFT
from s2rstore.findings.groups import GROUPINGS, SECTORS, group_errors, groups_of
from s2rstore.index.schema import GAP_SHARES
from s2rstore.index.transaction import edit
from s2rstore.language import evaluation
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from tests.support import gaps, tiny
from tests.support.copies import copy_store


def by_kind(report: FindingReport) -> dict[str, Finding]:
    return {finding.kind: finding for finding in report.findings}


def real_errors(store: Store) -> pd.DataFrame:
    """Real errors in metres per instance, a column per run, NaN where it was trained on."""
    rows = store.execute("SELECT iid, run, room, real_error_m, sim_split FROM pair")
    table = pd.DataFrame(rows, columns=["iid", "run", "room", "error", "split"])
    table.loc[table.split == "train", "error"] = np.nan
    return table.pivot_table("error", ["iid", "room"], "run", dropna=False).dropna(how="all")


@pytest.mark.parametrize("run", ["vanilla", "dataaug"])
@pytest.mark.parametrize("store", ["marked", "plain"])
def test_every_expression_selects_exactly_the_counted_instances(store, run, request):
    with s2rstore.open(request.getfixturevalue(store)) as opened:
        report = find_all(opened, run)
        selecting = [f for f in report.findings if f.expression is not None]
        assert {"worst room", "worst heading", "best run"} <= {f.kind for f in selecting}
        for finding in selecting:
            text = str(finding.expression)
            assert evaluation.select(opened, text, finding.run).sum() == finding.n
            query, parameters = evaluation.sql(opened, text, finding.run)
            assert len(opened.execute(query, parameters)) == finding.n


def test_the_worst_room_has_the_largest_median_of_new_instances(marked):
    with s2rstore.open(marked) as store:
        finding = by_kind(find_all(store, "vanilla"))["worst room"]
        errors = real_errors(store)["vanilla"].dropna().groupby("room")
    assert finding.evident
    assert finding.values["room"] == errors.median().idxmax() == "right"
    assert finding.values["median_real_error_m"] == pytest.approx(errors.median().max())
    assert finding.n == errors.size()["right"]
    medians = errors.median()
    assert finding.values["difference_to_others_m"] == pytest.approx(
        medians["right"] - medians["left hall"]
    )


def test_the_best_run_is_compared_on_instances_new_to_all(marked):
    with s2rstore.open(marked) as store:
        finding = by_kind(find_all(store, "vanilla"))["best run"]
        common = real_errors(store).dropna()
    assert finding.evident
    assert (finding.run, finding.n) == ("dataaug", len(common))
    assert finding.expression == 'run("vanilla").new'
    assert finding.values["mean_real_error_m"] == pytest.approx(common.dataaug.mean())
    difference = (common.vanilla - common.dataaug).mean()
    assert finding.values["difference_to_next_m"] == pytest.approx(difference)


def test_the_best_run_is_evident_only_against_every_other_run(plain):
    """The next run differs reliably, the one behind it by more, but not reliably."""
    with s2rstore.open(plain) as store:
        rows = np.arange(len(store.instances))
        new = np.ones(rows.size, dtype=np.bool_)
        noise = np.where(rows % 60 < 30, 6.0, -5.0)
        near_noise = 0.05 * np.sin(7 * rows)
        best, near, far = (
            run_differences.RunErrors(name, errors, new)
            for name, errors in (
                ("best", np.ones(rows.size)),
                ("near", 1.2 + near_noise),
                ("far", 1.4 + noise),
            )
        )
        alone = run_differences.best_run(store, [best, near])
        finding = run_differences.best_run(store, [best, near, far])
    assert alone.evident
    assert (finding.run, finding.other, finding.comparisons) == ("best", "near", 2)
    assert not finding.evident
    assert "not evident against far" in finding.evidence


def test_the_largest_regression_is_where_the_run_is_worst(marked):
    with s2rstore.open(marked) as store:
        finding = by_kind(find_all(store, "vanilla"))["largest regression"]
        better = by_kind(find_all(store, "dataaug"))["largest regression"]
        common = real_errors(store).dropna()
    assert finding.evident
    assert (finding.values["room"], finding.other) == ("right", "dataaug")
    here = common.xs("right", level="room")
    assert finding.values["increase_m"] == pytest.approx((here.vanilla - here.dataaug).mean())
    assert finding.comparisons == 3
    assert not better.evident
    assert better.text.startswith("none, nearest is ") == (better.values["increase_m"] <= 0)


def test_a_store_without_differences_says_that_nothing_is_evident(tmp_path):
    path = tiny.build(tmp_path / "s.s2r", n=80, runs=("vanilla", "twin"))
    with edit(path) as draft:
        for side in ("sim", "real"):
            draft.rows(
                "UPDATE prediction SET error = 1 + (iid * 7919 % 80) / 80.0 WHERE side = ?", [side]
            )
        unknown = ", ".join(f"{name} = NULL" for name in GAP_SHARES)
        draft.rows(f"UPDATE prediction SET {unknown}")
    with s2rstore.open(path) as store:
        report = find_all(store, "vanilla")
    assert report.summary == "nothing is evident for vanilla"
    assert report.findings
    for finding in report.findings:
        assert not finding.evident
        assert finding.statement.endswith("; not evident")
        assert "(not evident): " in finding.message


def test_one_run_is_compared_with_none(tmp_path):
    path = tiny.build(tmp_path / "s.s2r", n=40, runs=("vanilla",))
    with s2rstore.open(path) as store:
        report = find_all(store, "vanilla")
    assert {"best run", "largest regression"}.isdisjoint(by_kind(report))
    assert "best run: there is only one run" in report.missing


def test_without_rooms_there_is_no_worst_room(store_copy):
    path = store_copy
    with edit(path) as draft:
        draft.rows("DELETE FROM room")
        draft.rows("UPDATE instance SET room = NULL")
    with s2rstore.open(path) as store:
        report = find_all(store, "vanilla")
    assert "worst room: the data set has no rooms" in report.missing
    assert "worst heading" in by_kind(report)


def test_a_run_that_was_trained_on_everything_has_no_figures(tmp_path):
    path = tiny.build(tmp_path / "s.s2r", n=40, runs=("vanilla",))
    with edit(path) as draft:
        draft.rows("UPDATE prediction SET split = 'train' WHERE side = 'sim'")
    with s2rstore.open(path) as store:
        report = find_all(store, "vanilla")
    assert report.missing[0] == "vanilla was trained on all its instances, so none is new to it"
    assert not any(finding.n_of == "instances" for finding in report.findings)


@pytest.mark.parametrize(
    "text", ["{", "[]", "null", '{"runs": 3}', '{"runs": {"vanilla": "key0"}}']
)
def test_a_damaged_score_is_named(plain, tmp_path, text):
    path = copy_store(plain, tmp_path / "s.s2r")
    with edit(path) as draft:
        draft.set_provenance("score", {"report": text})
    with s2rstore.open(path) as store:
        report = find_all(store, "vanilla")
    assert "worst room" in by_kind(report)
    assert any(line.startswith("costliest factor: ") for line in report.missing)


def score(run_key: str) -> str:
    factor = {"run": "vanilla", "n": 48, "gain": 0.5, "gain_low": -0.1, "gain_high": 1.0}
    heatmap = {"run": "vanilla", "place": "floor", "side": "both", "precision": 0.9,
               "base_rate": 0.1}  # fmt: skip
    return json.dumps({
        "runs": {"vanilla": run_key},
        "factors": [
            {**factor, "factor": "lights", "cost": 2.0, "cost_low": 1.0, "cost_high": 3.0},
            {**factor, "factor": "depth", "cost": 0.2, "cost_low": -1.0, "cost_high": 1.5},
        ],
        "heatmaps": [
            {**heatmap, "kind": kind, "mode": None, "auroc": auroc, "auroc_low": auroc - 0.05,
             "auroc_high": auroc + 0.05, "tested": auroc, "tested_low": auroc - 0.06,
             "tested_high": auroc + 0.06}
            for kind, auroc in (("feature_distance", 0.7), ("harmonised_distance", 0.9))
        ],
    })  # fmt: skip


def test_factor_and_heatmap_come_from_the_score_of_the_run(plain, tmp_path):
    path = copy_store(plain, tmp_path / "s.s2r")
    with edit(path) as draft:
        draft.set_provenance("score", {"report": score("key0")})
    with s2rstore.open(path) as store:
        found = by_kind(find_all(store, "vanilla"))
    factor, heatmap = found["costliest factor"], found["best heatmap"]
    assert (factor.values["factor"], factor.values["cost_m"], factor.n) == ("lights", 2.0, 48)
    assert factor.evident
    assert factor.expression is None
    assert heatmap.heat == ("harmonised_distance", None)
    assert heatmap.evident


@pytest.mark.parametrize(("half_width", "evident"), [(0.04, True), (0.06, False)])
def test_the_best_heatmap_is_compared_with_all_other_kinds(plain, tmp_path, half_width, evident):
    """The intervals that hold for all heatmaps at once decide, not those of one heatmap."""
    report = json.loads(score("key0"))
    row = report["heatmaps"][0]

    def scored(kind: str, auroc: float) -> dict[str, object]:
        tested = {"tested_low": auroc - half_width, "tested_high": auroc + half_width}
        return {**row, "kind": kind, "auroc": auroc, "auroc_low": auroc - 0.04,
                "auroc_high": auroc + 0.04, "tested": auroc, **tested}  # fmt: skip

    row, *others = scored("harmonised_distance", 0.9), *(scored(f"kind{n}", 0.8) for n in range(6))
    report["heatmaps"] = [row, *others]
    path = copy_store(plain, tmp_path / "s.s2r")
    with edit(path) as draft:
        draft.set_provenance("score", {"report": json.dumps(report)})
    with s2rstore.open(path) as store:
        found = by_kind(find_all(store, "vanilla"))["best heatmap"]
    assert found.evident == evident
    assert found.comparisons == 6
    assert "corrected for 7 heatmaps" in found.evidence


def test_a_score_of_an_earlier_computation_does_not_count(plain, tmp_path):
    path = copy_store(plain, tmp_path / "s.s2r")
    with edit(path) as draft:
        draft.set_provenance("score", {"report": score("another key")})
    with s2rstore.open(path) as store:
        found = by_kind(find_all(store, "vanilla"))
    assert found["costliest factor"].values["factor"] == "lighting"
    assert not found["best heatmap"].evident
    assert found["best heatmap"].values["source"] == "shipped ranking"


def test_drift_compares_the_first_and_the_last_measured_night(plain, monkeypatch):
    week = gaps.week()
    with s2rstore.open(plain) as store:
        monkeypatch.setattr(DRIFT.reader, "file_stamp", lambda path: (1, 1, 1))
        monkeypatch.setattr(DRIFT.reader, "read", lambda path: gaps.history(*week))
        found = DRIFT.gap_drift(store, "vanilla", Path("week.duckdb"))
        assert found.values["axis"] == "task"
        assert found.values["change_percent"] == pytest.approx(27.0 - 7.0)
        assert not found.evident
        assert found.n == 7
        assert "7 of 31 measurements" in found.evidence
        same = [replace(night, measured=1) for night in week]
        monkeypatch.setattr(DRIFT.reader, "read", lambda path: gaps.history(*same))
        assert DRIFT.gap_drift(store, "vanilla", Path("week.duckdb")) is None


@pytest.mark.parametrize("rise", [0.0, 20.0])
def test_only_the_alarm_of_the_nightly_makes_a_drift_evident(plain, monkeypatch, rise):
    """Nights vary by more than the interval of a night; the worst axis is not the grown one."""
    spread = np.random.default_rng(3).normal(0, 4, 45)
    nights = [
        gaps.night(n, {"visual": 60.0 + s, "task": 10.0 + s + (rise if n > 35 else 0)}, 0.5)
        for n, s in enumerate(spread, start=1)
    ]
    monkeypatch.setattr(DRIFT.reader, "file_stamp", lambda path: (1, 1, 1))
    monkeypatch.setattr(DRIFT.reader, "read", lambda path: gaps.history(*nights))
    with s2rstore.open(plain) as store:
        found = DRIFT.gap_drift(store, "vanilla", Path("nights.duckdb"))
    assert found.evident == (rise > 0)
    assert found.values["axis"] == ("task" if rise else "visual")


def test_json_holds_units_intervals_and_expressions(marked):
    with s2rstore.open(marked) as store:
        report = find_all(store, "vanilla")
        new = int(run_metrics.population(store, "vanilla").sum())
    for finding in report.findings:
        data = json.loads(json.dumps(finding.as_json(), allow_nan=False))
        assert set(data) == {"kind", "text", "evidence", "evident", "run", "other_run", "n", "n_of",
                             "values", "interval", "expression"}  # fmt: skip
        if data["n_of"] == "instances":
            assert data["n"] <= new
            assert data["interval"]["of"] in data["values"]
            assert data["interval"]["level"] >= 0.95
        for name, value in data["values"].items():
            assert isinstance(value, str) or name.endswith(("_m", "_percent", "auroc", "cells",
                                                            "chance", "factors"))  # fmt: skip


def test_the_bounds_of_a_factor_are_those_for_all_factors_at_once():
    row = {"run": "vanilla", "n": 48, "gain": 0.0, "gain_low": -1.0, "gain_high": 1.0,
           "cost": 2.2, "cost_low": 0.2, "cost_high": 4.2}  # fmt: skip
    others = [{**row, "factor": f"f{k}", "cost": 0.0} for k in range(19)]
    alone, among = (
        costliest_factor.of_score([{**row, "factor": "lights"}, *rest], "vanilla")
        for rest in ([], others)
    )
    assert (alone.evident, alone.comparisons) == (True, 1)
    assert (among.evident, among.comparisons) == (True, 20)
    assert among.interval.level == pytest.approx(0.9975)
    assert "corrected for their number" in among.evidence


def test_drift_dates_a_measurement_by_the_night_that_made_it(plain, monkeypatch):
    """Nights without new evidence repeat the figures of the last measurement."""
    week = [replace(night, measured=1 if night.id < 5 else 5) for night in gaps.week()]
    monkeypatch.setattr(DRIFT.reader, "file_stamp", lambda path: (1, 1, 1))
    monkeypatch.setattr(DRIFT.reader, "read", lambda path: gaps.history(*week))
    with s2rstore.open(plain) as store:
        found = DRIFT.gap_drift(store, "vanilla", Path("week.duckdb"))
    assert (found.values["first_night"], found.values["last_night"]) == ("2026-11-16", "2026-11-20")
    assert "from 2026-11-16 to 2026-11-20, n 2 nights" in found.text


def pairs(store: Store, run: str) -> pd.DataFrame:
    """The new instances of a run as stored, with their groups computed by pandas."""
    columns = "iid, room, trajectory, heading_rad, curvature_deg, sim_error_m, real_error_m"
    names = ("iid", "room", "trajectory", "heading", "curvature", "sim_error", "real_error")
    rows = store.execute(
        f"SELECT {columns} FROM pair WHERE run = ? AND sim_split NOT IN "
        "('train', 'validation') AND real_split NOT IN ('train', 'validation')", [run],
    )  # fmt: skip
    table = pd.DataFrame(rows, columns=list(names))
    degrees = np.degrees(table.heading)
    centres = (np.round(degrees / 45) * 45).astype(int).replace(-180, 180)
    return table.assign(
        gap=table.real_error - table.sim_error,
        room=table.room.fillna("no room"),
        heading=centres.astype(str) + " deg",
        curvature=np.where(table.curvature.abs() < 10, "straight", "curved"),
    )


CROSSED = (*GROUPINGS, "room,heading", "trajectory,curvature")


@pytest.mark.parametrize("grouping", CROSSED)
@pytest.mark.parametrize("run", ["vanilla", "dataaug"])
def test_medians_and_counts_equal_those_of_pandas(marked, grouping, run):
    with s2rstore.open(marked) as store:
        new = run_metrics.population(store, run)
        rows = group_errors(store, run, groups_of(store, grouping), new)
        table = pairs(store, run)
    table = table.groupby(table[grouping.split(",")].agg(", ".join, axis=1))
    assert {row.group.name: row.n for row in rows} == table.size().to_dict()
    for row in rows:
        expected = table.get_group(row.group.name)
        assert row.real.value == pytest.approx(expected.real_error.median())
        assert row.sim == pytest.approx(expected.sim_error.median())
        assert row.gap == pytest.approx(expected.gap.median())


@pytest.mark.parametrize("grouping", CROSSED)
def test_the_expression_of_a_group_selects_exactly_its_instances(marked, grouping):
    with s2rstore.open(marked) as store:
        new = run_metrics.population(store, "vanilla")
        grouped = groups_of(store, grouping)
        for code, group in enumerate(grouped.groups):
            selected = evaluation.select(store, group.expression, "vanilla")
            assert np.array_equal(selected, new & (grouped.codes == code))


@pytest.mark.parametrize("grouping", ["", "day", "room,room", "room,heading,curvature", "room,"])
def test_unknown_groupings_are_refused(marked, grouping):
    with s2rstore.open(marked) as store, pytest.raises(RequestError, match="one or two different"):
        groups_of(store, grouping)


def test_headings_on_the_edge_of_two_sectors_belong_to_one(tmp_path):
    path = tiny.build(tmp_path / "s.s2r", n=32)
    with edit(path) as draft:
        draft.rows("UPDATE instance SET heading = radians(iid * 11.25 - 180)")
    with s2rstore.open(path) as store:
        grouped = groups_of(store, "heading")
        selections = [evaluation.select(store, g.expression, "vanilla") for g in grouped.groups]
    assert np.array_equal(np.sum(selections, axis=0), np.ones(32))
    assert np.bincount(grouped.codes, minlength=SECTORS).tolist() == [4] * SECTORS


def test_an_unknown_curvature_belongs_to_no_group(store_copy):
    path = store_copy
    with edit(path) as draft:
        draft.rows("UPDATE instance SET curvature = NULL WHERE iid < 10")
    with s2rstore.open(path) as store:
        grouped = groups_of(store, "curvature")
        rows = group_errors(store, "vanilla", grouped, np.ones(40, dtype=np.bool_))
    assert (grouped.codes[:10] == -1).all()
    assert sum(row.n for row in rows) == 30


def test_groups_without_instances_are_left_out(plain):
    with s2rstore.open(plain) as store:
        left = np.zeros(120, dtype=np.bool_)
        left[5] = True
        rows = group_errors(store, "vanilla", groups_of(store, "trajectory"), left)
    assert [(row.group.name, row.n) for row in rows] == [("a", 1)]
    assert math.isnan(rows[0].real.low)
