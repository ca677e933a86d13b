"""A week of nights: a regression fails the gate; known evidence is not measured again."""

from __future__ import annotations

import os
import shutil
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from s2rstore.errors import InconclusiveError, RequestError
from s2rstore.gap_history import reader
from s2rstore.gap_history.change_check import Change, change_of
from s2rstore.gap_history.reader import Night
from s2rstore.index.transaction import edit
from s2rstore.intervals.sequential import BASELINE
from s2rtools.gap.axis import GapSettings
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.run import NightRun, nightly
from tests.nightly.conftest import files
from tests.support import gaps, nights
from tests.support.nights import day

pytestmark = pytest.mark.usefixtures("constant_plot")


def with_request(config: NightlyConfig, **changes: Any) -> NightlyConfig:
    """The configuration with changes of its request to the gate."""
    return replace(config, request=replace(config.request, **changes))


def test_repeating_a_night_changes_nothing(week):
    week.night(1)
    week.night(2, new_log=False)
    before = files(week.config)
    for number in (2, 1):
        repeated = week.night(number, new_log=False)
        assert (repeated.new, repeated.computed, repeated.written) == (False, False, ())
        assert files(week.config) == before
    assert week.calls == 1
    assert len(reader.read(week.config.history).nights) == 2
    assert os.readlink(week.config.reports / "latest") == str(day(2))


def test_a_night_without_new_evidence_reuses_results_and_ages(week):
    first = week.night(1).night
    night_run = week.night(4, new_log=False)
    assert (night_run.new, night_run.computed, week.calls) == (True, False, 1)
    assert (night_run.night.measured, night_run.night.gap) == (first.id, first.gap)
    assert (night_run.night.evidence_age, night_run.night.stale) == (3, True)
    assert night_run.night.evidence_since == day(1)
    assert (first.evidence_age, first.stale) == (0, False)
    renewed = week.night(5).night
    assert (renewed.evidence_age, renewed.stale, week.calls) == (0, False, 2)


def test_deleting_logs_does_not_renew_the_evidence(week):
    """Deleting old logs must not hide that recording has stopped."""
    drives = week.config.source.parent / "drives"
    for number in range(1, 4):
        week.night(number)
    for number, deleted in ((4, "day1"), (6, "day2")):
        shutil.rmtree(drives / deleted)
        night = week.night(number, new_log=False).night
        assert (night.evidence_since, night.evidence_age) == (day(3), number - 3)
    assert night.stale


def test_changed_evidence_replaces_the_night(week):
    first = week.night(1)
    (week.config.source.parent / "drives" / "day1" / "real.csv").write_text("else\n")
    second = week.night(1, new_log=False)
    loaded = reader.read(week.config.history)
    assert [night.id for night in loaded.nights] == [1, 2]
    assert loaded.of_configuration("lab")[0].key == second.night.key != first.night.key
    log = week.config.source.parent / "drives" / "day1" / "real.csv"
    log.write_text("time,x,y,heading\n0,1,0,0\n")
    restored = week.night(1, new_log=False)
    assert (restored.new, restored.computed, restored.night.measured) == (True, False, 1)
    assert reader.read(week.config.history).of_configuration("lab")[0].id == 3


def test_a_changed_configuration_is_measured_again(week):
    config = week.config
    week.night(1)
    for change in (
        {"threshold": 20.0}, {"margin": 0.1}, {"settings": GapSettings(seed=2)},
        {"expression": "worst15"}, {"axes": ("task",)}, {"run": "dataaug"},
        {"options": {"reach": "2"}},
    ):  # fmt: skip
        week.config = with_request(config, **change)
        assert week.night(1, new_log=False).computed, change
    week.config = replace(config, stale_after=9.0)
    assert week.night(1, new_log=False).computed


def test_other_files_are_identified_by_content(week):
    config = week.config
    for name in ("reference", "golden", "features"):
        path = config.source.parent / f"{name}.json"
        path.write_text("1")
        week.config = with_request(config, **{name: path})
        week.night(1)
        path.touch()
        assert not week.night(1, new_log=False).new, name
        path.write_text("2")
        assert week.night(1, new_log=False).computed, name


@pytest.mark.parametrize(
    ("name", "text"),
    [("net.toml", 'weights = "net.bin"\n'), ("net.json", '{"weights": "net.bin"}')],
)
def test_a_network_is_identified_by_its_weights(week, name, text):
    path = week.config.source.parent / name
    path.write_text(text)
    week.config = with_request(week.config, features=path)
    with pytest.raises(RequestError, match=r"net\.bin: cannot be read"):
        week.night(1)
    (path.parent / "net.bin").write_bytes(b"1")
    week.night(1)
    assert not week.night(1, new_log=False).new
    (path.parent / "net.bin").write_bytes(b"2")
    assert week.night(1, new_log=False).computed


def test_a_new_generation_is_measured_again_without_new_evidence(week):
    week.night(1)
    with edit(week.config.store) as draft:
        draft.set_provenance("run:vanilla", {"remark": "published again"})
    night_run = week.night(2, new_log=False)
    assert night_run.computed
    assert (night_run.night.evidence_since, night_run.night.evidence_age) == (day(1), 1)


def test_other_options_on_the_same_logs_are_no_new_evidence(week):
    sysid, week.config = week.config.sysid, replace(week.config, sysid=None)
    first = week.night(1).night
    week.config = replace(week.config, sysid=sysid)
    second = week.night(2, new_log=False).night
    week.config = with_request(replace(week.config, sysid=None), drives="odometry")
    third = week.night(3, new_log=False).night
    assert len({first.key, second.key, third.key}) == 3
    assert first.evidence == second.evidence != third.evidence


def test_partial_copies_are_ignored(week):
    week.night(1)
    (week.config.source.parent / "drives" / ".real.csv.part").write_text("half")
    assert not week.night(1, new_log=False).new


def test_two_gates_share_a_history(week):
    week.night(1)
    reports = week.config.reports / "other"
    week.config = replace(week.config, name="other", metrics=None, reports=reports)
    assert week.night(1, new_log=False).new
    loaded = reader.read(week.config.history)
    assert [len(loaded.of_configuration(name)) for name in ("lab", "other")] == [1, 1]


@pytest.mark.parametrize(
    ("error", "outcome", "code", "tag"),
    [(RequestError("ref.json: does\nnot fit"), "ERROR", 2, "error"),
     (InconclusiveError("3 images"), "INCONCLUSIVE", 3, "skipped")],
)  # fmt: skip
def test_a_night_that_cannot_be_measured_never_passes(week, error, outcome, code, tag):
    def failing_measure(store: object, config: object) -> dict:
        raise error

    def run_night() -> NightRun:
        return nightly(week.config, day(2), failing_measure, week.estimate, nights.clock())

    week.night(1)
    (week.config.source.parent / "drives" / "day1" / "real.csv").write_text("new\n")
    night_run = run_night()
    reason = " ".join(str(error).split())
    night = night_run.night
    assert (night.outcome, night.exit_code, night.reason) == (outcome, code, reason)
    assert night.refused
    case = ET.parse(week.config.reports / str(day(2)) / "junit.xml").find(".//testcase")
    assert case is not None
    assert (case.attrib["name"], case[0].tag) == ("headline", tag)
    assert reason in case[0].attrib["message"]
    for name in ("report.html", "report.md", "report.json"):
        assert reason in (week.config.reports / str(day(2)) / name).read_text()
    assert week.config.metrics is not None
    metrics_text = week.config.metrics.read_text()
    lines = [line for line in metrics_text.splitlines() if 'axis="all"' in line]
    assert [line for line in lines if line.endswith(" 1.0") and f'="{outcome}"' in line]
    assert [line for line in lines if "exit_code" in line and line.endswith(f" {code}.0")]
    assert "s2r_gap{" not in metrics_text
    before = files(week.config)
    assert not run_night().new
    assert files(week.config) == before
    repeated = week.night(2, new_log=False)
    assert (repeated.new, repeated.computed, repeated.night.exit_code) == (True, True, 0)
    assert [n.exit_code for n in reader.read(week.config.history).nights] == [0, code, 0]


def test_a_failed_identification_request_never_passes(week):
    def failing_estimate(config: object) -> list:
        raise RequestError("one: no commands.csv")

    assert nightly(week.config, day(1), week.measure, failing_estimate).night.exit_code == 2


def test_an_invalid_run_writes_nothing(week):
    folder = week.config.source.parent
    before = sorted(folder.rglob("*"))
    week.config = with_request(week.config, run="unknown")
    with pytest.raises(RequestError, match="unknown"):
        nightly(week.config, day(1), week.measure, week.estimate)
    assert sorted(folder.rglob("*")) == before


def test_stale_evidence_is_inconclusive_and_hides_no_failure(week):
    week.night(1)
    stale = week.night(4, new_log=False).night
    assert (stale.headline, stale.outcome, stale.exit_code) == ("PASS", "INCONCLUSIVE", 3)
    assert week.night(5).night.exit_code == 1
    assert week.night(9, new_log=False).night.exit_code == 1


def test_two_gates_cannot_share_output_files(week):
    week.night(1)
    before, gate = files(week.config), week.config
    assert gate.metrics is not None
    for name, paths in (("reports", {"metrics": gate.source.parent / "other.prom"}),
                         ("metrics", {"reports": gate.reports / "other"})):  # fmt: skip
        week.config = replace(gate, name="other", **paths)
        with pytest.raises(RequestError, match=rf"output\.{name}: .* belongs to the gate 'lab'"):
            week.night(1, new_log=False)
    assert files(gate) == before
    assert week.calls == 1


def test_evidence_that_changes_during_the_measurement_is_rejected(week):
    def measure_with_new_log(store: object, config: NightlyConfig) -> dict:
        (config.source.parent / "drives" / "late.csv").write_text("new")
        return week.measure(store, config)

    with pytest.raises(RequestError, match="changed during the measurement"):
        nightly(week.config, day(1), measure_with_new_log, week.estimate)
    assert not week.config.history.exists()


def test_a_path_below_a_file_is_reported_before_measuring(week):
    week.config = replace(week.config, reports=week.config.source / "reports")
    with pytest.raises(RequestError, match=r"output\.reports"):
        week.night(1)
    assert week.calls == 0


def test_without_a_reference_only_the_golden_run_is_judged(week):
    verdict = {"outcome": "INCONCLUSIVE", "threshold": 15.0, "worst": None, "gap": None,
               "gap_low": None, "gap_high": None, "reason": "no reference"}  # fmt: skip

    def golden_passes(store, config) -> dict:
        return nights.report(store, {"task": 5.0}, golden=nights.golden(0.0), reference=None,
                             verdict=verdict)  # fmt: skip

    def without_golden(store, config) -> dict:
        return golden_passes(store, config) | {"golden": None}

    assert nightly(week.config, day(1), golden_passes, week.estimate).night.exit_code == 0
    week.config = with_request(week.config, settings=GapSettings(seed=9))
    night_run = nightly(week.config, day(2), without_golden, week.estimate)
    assert (night_run.night.exit_code, night_run.night.worst) == (3, None)


OF = ("tiny", "vanilla", "all")


def past(count: int, level: float = 5.0) -> list[Night]:
    rng = np.random.default_rng(0)
    return [gaps.night(number, {"task": level + rng.normal(0, 1)}) for number in range(1, count)]


def change(nights: list[Night], gap: float, anchor: float = 1.1) -> Change | None:
    return change_of(nights, *OF, {"task": (gap, anchor)})


def test_a_gap_that_grows_fails_before_it_reaches_the_threshold() -> None:
    nights = past(BASELINE + 1)
    for number in range(BASELINE + 1, BASELINE + 6):
        nights.append(gaps.night(number, {"task": 11.0}))
    found = change(nights, 11.0)
    assert found is not None
    assert found.outcome == "FAIL"
    assert found.reason.startswith(f"task: grown since measurement {BASELINE + 1} of 36 over G ")
    steady = change(past(BASELINE + 6), 5.0)
    assert steady is not None
    assert steady.outcome == "PASS"


@pytest.mark.parametrize(
    "other", [{"run": "dataaug"}, {"expression": "worst15"}, {"dataset": "lab"}, {"measured": 7}]
)
def test_nights_of_something_else_and_repeated_figures_do_not_count(other) -> None:
    nights = [replace(night, **other) for night in past(BASELINE + 6)]
    found = change(nights, 5.0)
    assert found is not None
    assert found.outcome == "INCONCLUSIVE"
    assert found.reason == f"task: {2 if 'measured' in other else 1} of 31 measurements"


def test_another_anchor_starts_again_and_an_unjudged_night_has_no_change() -> None:
    found = change(past(BASELINE + 6), 5.0, anchor=2.0)
    assert found is not None
    assert found.outcome == "INCONCLUSIVE"
    assert change_of(past(40), *OF, {}) is None
