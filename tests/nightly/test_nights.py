"""A week of nights: a regression turns the gate red, and what is known already changes nothing."""

from __future__ import annotations

import datetime
import os
import shutil
from dataclasses import replace
from xml.etree import ElementTree as ET

import pytest

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.gap_history import reader
from s2rstore.index.transaction import edit
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.run import NightRun, nightly
from tests.nightly.conftest import files
from tests.support import nights
from tests.support.nights import Week, day


def test_a_regression_on_day_five_turns_the_gate_red(told_week: Week) -> None:
    found = reader.read(told_week.config.history).of_configuration("lab")
    assert [night.night for night in found] == [day(number) for number in range(1, 8)]
    assert [night.exit_code for night in found] == [0, 0, 0, 0, 1, 1, 1]
    assert [night.outcome for night in found] == ["PASS"] * 4 + ["FAIL"] * 3
    assert found[4].worst == "task"
    assert found[4].gap.low > 15 > found[3].gap.high
    assert {axis.axis for axis in found[4].axes} == {"visual", "task", "dynamics", "delay"}


def test_the_same_night_again_changes_nothing(week: Week) -> None:
    for number in (1, 2):
        week.night(number)
    before, calls = files(week.config), week.calls
    rows = reader.read(week.config.history).nights
    again = week.night(2, new_log=False)
    assert (again.new, again.computed, again.written) == (False, False, ())
    assert files(week.config) == before
    assert week.calls == calls == 2
    assert len(reader.read(week.config.history).nights) == len(rows) == 2


def test_an_earlier_night_again_changes_nothing_either(week: Week) -> None:
    week.night(1)
    before = None
    week.night(2, new_log=False)
    before = files(week.config)
    assert not week.night(1, new_log=False).new
    assert files(week.config) == before
    assert os.readlink(week.config.reports / "latest") == str(day(2))


def test_a_night_without_new_evidence_shares_its_figures_and_ages(week: Week) -> None:
    first = week.night(1).night
    done = week.night(4, new_log=False)
    assert (done.new, done.computed, week.calls) == (True, False, 1)
    assert (done.night.measured, done.night.gap) == (first.id, first.gap)
    assert (done.night.evidence_age, done.night.stale) == (3, True)
    assert done.night.evidence_since == day(1)
    assert (first.evidence_age, first.stale) == (0, False)
    fresh = week.night(5).night
    assert (fresh.evidence_age, fresh.stale, week.calls) == (0, False, 2)


def test_logs_that_are_deleted_make_the_rest_no_newer(week: Week) -> None:
    """A recorder that stopped is not hidden by old logs being cleared away."""
    drives = week.config.source.parent / "drives"
    for number in range(1, 4):
        week.night(number)
    for number, gone in ((4, "day1"), (6, "day2")):
        shutil.rmtree(drives / gone)
        night = week.night(number, new_log=False).night
        assert (night.evidence_since, night.evidence_age) == (day(3), number - 3)
    assert night.stale


def test_what_changes_in_a_night_adds_a_row_that_counts(week: Week) -> None:
    first = week.night(1)
    (week.config.source.parent / "drives" / "day1" / "real.csv").write_text("else\n")
    second = week.night(1, new_log=False)
    found = reader.read(week.config.history)
    assert [night.id for night in found.nights] == [1, 2]
    assert found.of_configuration("lab")[0].key == second.night.key != first.night.key
    (week.config.source.parent / "drives" / "day1" / "real.csv").write_text(
        "time,x,y,heading\n0,1,0,0\n"
    )
    back = week.night(1, new_log=False)
    assert (back.new, back.computed, back.night.measured) == (True, False, 1)
    assert reader.read(week.config.history).of_configuration("lab")[0].id == 3


@pytest.mark.parametrize(
    "change",
    [{"threshold": 20.0}, {"margin": 0.1}, {"seed": 2}, {"replicates": 500}, {"select": "worst15"},
     {"axes": ("task",)}, {"stale_after": 9.0}, {"run": "dataaug"}],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_what_matters_in_the_configuration_is_measured_anew(week: Week, change: dict) -> None:
    week.night(1)
    week.config = replace(week.config, **change)
    assert week.night(1, new_log=False).computed


@pytest.mark.parametrize("name", ["reference", "golden", "features"])
def test_other_files_are_known_by_their_content(week: Week, name: str) -> None:
    path = week.config.source.parent / "file.json"
    path.write_text("1")
    week.config = replace(week.config, **{name: path})
    week.night(1)
    path.touch()
    assert not week.night(1, new_log=False).new
    path.write_text("2")
    assert week.night(1, new_log=False).computed


@pytest.mark.parametrize(
    ("name", "text"),
    [("net.toml", 'weights = "net.bin"\n'), ("net.json", '{"weights": "net.bin"}')],
)
def test_a_network_is_known_by_its_weights(week: Week, name: str, text: str) -> None:
    path = week.config.source.parent / name
    path.write_text(text)
    week.config = replace(week.config, features=path)
    with pytest.raises(RequestError, match=r"net\.bin: cannot be read"):
        week.night(1)
    (path.parent / "net.bin").write_bytes(b"1")
    week.night(1)
    assert not week.night(1, new_log=False).new
    (path.parent / "net.bin").write_bytes(b"2")
    assert week.night(1, new_log=False).computed


def test_a_new_generation_is_measured_anew_but_is_no_new_evidence(week: Week) -> None:
    week.night(1)
    with edit(week.config.store) as draft:
        draft.set_provenance("run:vanilla", {"remark": "published again"})
    done = week.night(2, new_log=False)
    assert done.computed
    assert (done.night.evidence_since, done.night.evidence_age) == (day(1), 1)


def test_what_is_asked_of_the_same_logs_is_no_new_evidence(week: Week) -> None:
    sysid, week.config = week.config.sysid, replace(week.config, sysid=None)
    first = week.night(1).night
    week.config = replace(week.config, sysid=sysid)
    second = week.night(2, new_log=False).night
    week.config = replace(week.config, drives="odometry", sysid=None)
    third = week.night(3, new_log=False).night
    assert len({first.key, second.key, third.key}) == 3
    assert first.evidence == second.evidence != third.evidence


def test_a_copy_under_way_does_not_count(week: Week) -> None:
    week.night(1)
    (week.config.source.parent / "drives" / ".real.csv.part").write_text("half")
    assert not week.night(1, new_log=False).new


def test_two_gates_share_a_history(week: Week) -> None:
    week.night(1)
    week.config = replace(
        week.config, name="other", metrics=None, reports=week.config.reports / "other"
    )
    assert week.night(1, new_log=False).new
    found = reader.read(week.config.history)
    assert [len(found.of_configuration(name)) for name in ("lab", "other")] == [1, 1]


@pytest.mark.parametrize(
    ("error", "word", "code", "tag"),
    [(RequestError("ref.json: does\nnot fit"), "ERROR", 2, "error"),
     (InconclusiveError("3 images"), "INCONCLUSIVE", 3, "skipped")],
)  # fmt: skip
def test_a_night_that_cannot_be_measured_is_never_green(
    week: Week, error: Exception, word: str, code: int, tag: str
) -> None:
    def refuse(store: object, config: object) -> dict:
        raise error

    def night() -> NightRun:
        return nightly(week.config, day(2), refuse, week.estimate, nights.clock())

    week.night(1)
    (week.config.source.parent / "drives" / "day1" / "real.csv").write_text("new\n")
    done = night()
    reason = " ".join(str(error).split())
    assert (done.night.outcome, done.night.exit_code, done.night.reason) == (word, code, reason)
    assert done.night.refused
    case = ET.parse(week.config.reports / str(day(2)) / "junit.xml").find(".//testcase")
    assert case is not None
    assert (case.attrib["name"], case[0].tag) == ("headline", tag)
    assert reason in case[0].attrib["message"]
    for name in ("report.html", "report.md", "report.json"):
        assert reason in (week.config.reports / str(day(2)) / name).read_text()
    assert week.config.metrics is not None
    told = week.config.metrics.read_text()
    lines = [line for line in told.splitlines() if 'axis="all"' in line]
    assert [line for line in lines if line.endswith(" 1.0") and f'="{word}"' in line]
    assert [line for line in lines if "exit_code" in line and line.endswith(f" {code}.0")]
    assert "s2r_gap{" not in told
    before = files(week.config)
    assert not night().new
    assert files(week.config) == before
    again = week.night(2, new_log=False)
    assert (again.new, again.computed, again.night.exit_code) == (True, True, 0)
    assert [n.exit_code for n in reader.read(week.config.history).nights] == [0, code, 0]


def test_a_simulator_that_cannot_be_identified_for_a_wrong_request_is_never_green(
    week: Week,
) -> None:
    def wrong(sysid: object) -> list:
        raise RequestError("one: no commands.csv")

    assert nightly(week.config, day(1), week.measure, wrong).night.exit_code == 2


def test_a_wrong_place_leaves_nothing(week: Week) -> None:
    here = week.config.source.parent
    before = sorted(here.rglob("*"))
    week.config = replace(week.config, run="unknown")
    with pytest.raises(RequestError, match="unknown"):
        nightly(week.config, day(1), week.measure, week.estimate)
    assert sorted(here.rglob("*")) == before


def test_stale_evidence_passes_nothing_and_hides_no_failure(week: Week) -> None:
    week.night(1)
    stale = week.night(4, new_log=False).night
    assert (stale.headline, stale.outcome, stale.exit_code) == ("PASS", "INCONCLUSIVE", 3)
    assert week.night(5).night.exit_code == 1
    assert week.night(9, new_log=False).night.exit_code == 1


def test_two_gates_do_not_overwrite_each_other(week: Week) -> None:
    week.night(1)
    before, gate = files(week.config), week.config
    assert gate.metrics is not None
    for name, places in (("reports", {"metrics": gate.source.parent / "other.prom"}),
                         ("metrics", {"reports": gate.reports / "other"})):  # fmt: skip
        week.config = replace(gate, name="other", **places)
        with pytest.raises(RequestError, match=rf"output\.{name}: .* belongs to the gate 'lab'"):
            week.night(1, new_log=False)
    assert files(gate) == before
    assert week.calls == 1


def test_evidence_that_changes_meanwhile_is_refused(week: Week) -> None:
    def slow(store: object, config: NightlyConfig) -> dict:
        (config.source.parent / "drives" / "late.csv").write_text("new")
        return week.measure(store, config)

    with pytest.raises(RequestError, match="changed during the measurement"):
        nightly(week.config, day(1), slow, week.estimate)
    assert not week.config.history.exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_place_that_cannot_be_written_is_named_before_measuring(week: Week) -> None:
    week.config.store.chmod(0o555)
    try:
        with pytest.raises(RequestError, match=r"output\.history"):
            week.night(1)
    finally:
        week.config.store.chmod(0o755)
    assert week.calls == 0


def test_a_place_inside_a_file_is_named_before_measuring(week: Week) -> None:
    week.config = replace(week.config, reports=week.config.source / "reports")
    with pytest.raises(RequestError, match=r"output\.reports"):
        week.night(1)
    assert week.calls == 0


def test_the_outcome_obeys_the_golden_run(week: Week) -> None:
    def worse(store, config) -> dict:
        return nights.report(store, {"task": 5.0}, golden=nights.golden(0.2))

    done = nightly(week.config, day(1), worse, week.estimate)
    assert (done.night.headline, done.night.golden, done.night.outcome) == ("PASS", "FAIL", "FAIL")
    assert done.night.exit_code == 1


def test_without_a_reference_only_the_golden_run_is_judged(week: Week) -> None:
    verdict = {"outcome": "INCONCLUSIVE", "threshold": 15.0, "worst": None, "gap": None,
               "gap_low": None, "gap_high": None, "reason": "no reference"}  # fmt: skip

    def fine(store, config) -> dict:
        return nights.report(store, {"task": 5.0}, golden=nights.golden(0.0), reference=None,
                             verdict=verdict)  # fmt: skip

    def nothing(store, config) -> dict:
        return fine(store, config) | {"golden": None}

    assert nightly(week.config, day(1), fine, week.estimate).night.exit_code == 0
    week.config = replace(week.config, seed=9)
    done = nightly(week.config, day(2), nothing, week.estimate)
    assert (done.night.exit_code, done.night.worst) == (3, None)


def test_nights_are_counted_in_days() -> None:
    assert day(7) - day(1) == datetime.timedelta(days=6)
