"""`s2r evaluate` and the exchange view: figures, what simulation adds, plans, refusals."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.findings.exchange_rate import exchange_rate
from s2rstore.index.transaction import edit
from s2rstore.metrics import exchange, recall
from s2rstore.metrics.evaluation import images_of, run_figures
from s2rstore.metrics.exchange import ExchangeChange, changed_runs, mean_errors
from s2rtools.nightly import measurement
from tests.support import tiny
from tests.support.copies import copy_store

PAIRS, SIMULATED = 240, 360


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Vanilla's real errors follow its sim errors; most instances have no real prediction of it."""
    path = tiny.build(tmp_path_factory.mktemp("evaluate") / "s.s2r", n=PAIRS + SIMULATED)
    rng = np.random.default_rng(4)
    sim = rng.lognormal(size=PAIRS + SIMULATED)
    real = sim + 0.25 * rng.lognormal(size=sim.size)
    simulated = rng.permutation(sim.size)[:SIMULATED].tolist()
    with edit(path) as draft:
        for side, errors in (("sim", sim), ("real", real)):
            pairs = ", ".join(f"({iid}, {error})" for iid, error in enumerate(errors))
            draft.rows(
                f"UPDATE prediction SET error = e.error FROM (VALUES {pairs}) AS e(iid, error) "
                f"WHERE prediction.iid = e.iid AND run = 'vanilla' AND side = '{side}'"
            )
        draft.rows(
            "DELETE FROM prediction WHERE run = 'vanilla' AND side = 'real' "
            f"AND iid IN ({', '.join(map(str, simulated))})"
        )
    return path


def test_simulated_instances_narrow_the_interval(store, s2r):
    found = s2r("evaluate", store, "--run", "vanilla", "--json").json
    assert (found["pairs"], found["simulated"]) == (PAIRS, SIMULATED)
    mean = found["figures"]["mean error"]
    alone, combined = mean["real_only"], mean["with_simulation"]
    assert combined["high"] - combined["low"] < 0.85 * (alone["high"] - alone["low"])
    assert mean["exchange_rate"]["low"] > 1.5
    assert mean["effective_images"] > 1.4 * PAIRS
    with s2rstore.open(store) as opened:
        columns = opened.run_columns("vanilla")
        real = columns.real.error[columns.attempted]
    assert alone["value"] == pytest.approx(real.mean(), abs=1e-5)
    assert found["figures"]["median error"]["real_only"]["value"] == pytest.approx(
        np.median(real), abs=1e-5
    )


def test_the_text_says_what_simulation_is_worth_and_what_to_add(store, s2r):
    text = s2r("evaluate", store, "--run", "vanilla", "--target", "0.2", "--rooms").printed
    assert "240 pairs of 2 trajectories" in text
    assert "one real image is worth" in text
    assert "more real images; " in text
    assert "beside unlimited simulated ones" in text
    assert "left hall" in text
    equal = s2r("evaluate", store, "--run", "dataaug").printed
    assert "simulation adds nearly nothing here" in equal


def test_two_runs_are_compared_on_common_pairs(store, s2r):
    text = s2r("evaluate", store, "--run", "vanilla", "--against", "dataaug").printed
    assert "decided: the mean error of dataaug is smaller than that of vanilla" in text
    found = s2r("evaluate", store, "--run", "vanilla", "--against", "dataaug", "--json").json
    assert found["differences"]["mean error"]["pairs"] == PAIRS
    assert found["plans"][0]["real_only"]["images"] == 0


def test_wrong_requests_are_refused(store, s2r):
    s2r("evaluate", store, "--run", "nobody").assert_refused("nobody")
    s2r("evaluate", store, "--against", "vanilla").assert_refused("this is the evaluated run")
    s2r("evaluate", store, "--target", "-1").assert_refused("expected metres above 0")
    s2r("evaluate", store, "--power", "0.9").assert_refused("--against")
    against = ("--run", "vanilla", "--against", "dataaug")
    s2r("evaluate", store, *against, "--power", "1").assert_refused("between 0 and 1")


def test_the_view_shows_the_same_numbers(store, s2r):
    """Rooms with enough pairs have an exchange rate."""
    found = s2r("evaluate", store, "--run", "vanilla", "--json").json
    rows = s2r("show", store, "exchange", "--run", "vanilla", "--json").json
    mean = found["figures"]["mean error"]
    shown = {row["figure"]: row for row in rows if row["of"] == "vanilla"}
    assert shown["mean error with simulation"]["low"] == pytest.approx(
        mean["with_simulation"]["low"], abs=1e-5
    )
    assert shown["exchange rate"]["value"] == pytest.approx(
        mean["exchange_rate"]["value"], abs=1e-5
    )
    known = {f"vanilla, {room['room']}": room["exchange_rate"]["value"] for room in found["rooms"]
             if room["exchange_rate"]["low"] is not None}  # fmt: skip
    assert 0 < len(known) == sum(room["pairs"] >= 100 for room in found["rooms"])
    rooms = {row["of"]: row["value"] for row in rows if row["of"].startswith("vanilla, ")}
    assert rooms == pytest.approx(known, abs=1e-5)
    assert s2r("show", store, "exchange", "--select", "none", "--json").json == []
    words = s2r("show", store, "exchange", "--run", "vanilla", "--words").printed
    assert "rate: what a real image is worth" in words


def test_the_exchange_rate_before_and_after_a_change(store, tmp_path, s2r):
    """Findings, gap and nightly show what `s2r evaluate --runs` does."""
    path = copy_store(store, tmp_path / "tuned.s2r")
    with edit(path) as draft:
        chain = '[{"name": "camera_fov", "value": 4.0}]'
        draft.rows("UPDATE run SET model = (SELECT model FROM run WHERE run = 'dataaug'), "
                   f"sim_adjustments = '{chain}' WHERE run = 'vanilla'")  # fmt: skip
    found = s2r("evaluate", path, "--run", "vanilla", "--runs", "--json").json
    (change,) = (each for each in found["runs"] if each["run"] == "vanilla")
    assert (change["baseline"], change["changes"]) == ("dataaug", "camera_fov=4")
    assert change["after"]["low"] > 1.5 > change["before"]["high"]
    assert change["evident"]
    assert "camera_fov=4)" in s2r("evaluate", path, "--run", "vanilla", "--runs").printed
    for run in ("vanilla", "dataaug"):  # the changed run, and that it is a change of
        findings = s2r("findings", path, "--run", run, "--json").json["findings"]
        (finding,) = (each for each in findings if each["kind"] == "exchange rate")
        assert (finding["run"], finding["other_run"]) == ("vanilla", "dataaug")
        assert finding["evident"]
        assert finding["interval"]["value"] == pytest.approx(change["after"]["value"], abs=1e-5)
    report = json.loads(
        s2r("gap", path, "--run", "vanilla", "--axis", "task", "--json").checked(3).out
    )
    assert report["exchange"]["before"]["value"] == pytest.approx(
        change["before"]["value"], abs=1e-5
    )
    rows = {row["parameter"]: row for row in measurement.exchange_rows(report)}
    assert rows["exchange rate"]["value"] == report["exchange"]["after"]["value"]
    assert rows["exchange rate before the changes"]["note"] == "camera_fov=4"
    with edit(path) as draft:  # a domain that was added later is the changed one
        draft.rows("INSERT INTO domain SELECT * REPLACE ('new' AS domain) FROM domain "
                   "WHERE domain = 'sim'")  # fmt: skip
        draft.rows("UPDATE run SET sim_adjustments = '[]', sim_domain = 'new' "
                   "WHERE run = 'vanilla'")  # fmt: skip
        draft.set_provenance("dataset", {"domain:new": {"added_at": "2026-11-01T00:00:00+00:00"}})
    with s2rstore.open(path) as opened:
        assert changed_runs(opened, "dataaug") == ["vanilla"]


def test_the_finding_is_the_change_that_raises_the_rate_most(store, monkeypatch):
    def change(opened, run, level):
        before, after = {"vanilla": (4.0, 3.0), "dataaug": (1.0, 2.0)}[run]
        rates = [replace(known, rate=replace(known.rate, value=each)) for each in (after, before)]
        return ExchangeChange(run, rates[0], "base", rates[1])

    with s2rstore.open(store) as opened:
        known = mean_errors(opened)["vanilla"]
        monkeypatch.setattr(exchange, "changed_runs", lambda *_: ["vanilla", "dataaug"])
        monkeypatch.setattr(exchange, "exchange_change", change)
        assert exchange_rate(opened, "base").run == "dataaug"


def test_images_without_a_pose_are_failures_of_recall_and_median(store, tmp_path, s2r):
    """A run that does not localise two of five images, on either side and without a real one."""
    path = copy_store(store, tmp_path / "lost.s2r")
    with edit(path) as draft:
        draft.rows(
            "UPDATE prediction SET x = NULL, y = NULL, heading = NULL, error = NULL, "
            "heading_error = NULL WHERE run = 'vanilla' AND (iid * 7919) % 5 < 2"
        )
    with s2rstore.open(path) as opened:
        expected = recall.side_recall(opened, "vanilla", "real")
        images = images_of(opened, ["vanilla"])
        sim = opened.run_columns("vanilla").sim.error[images.simulated]
        figures = {each.name: each.estimate for each in run_figures(opened, "vanilla", images)}
    assert images.simulated.size == SIMULATED
    assert 0 < np.isnan(sim).sum() < SIMULATED
    alone = figures["median error"].real_only
    assert (alone.low, alone.value, alone.high) == (
        expected.position.low, expected.position.value, expected.position.high
    )  # fmt: skip
    for point in expected.points:
        share = figures[f"recall ({point.name})"]
        assert share.real_only.value == pytest.approx(point.share.value)
        assert share.combined.value <= 0.7  # two of five fail in simulation, too
