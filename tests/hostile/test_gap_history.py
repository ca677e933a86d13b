"""Nights with a wrong clock date, and their withdrawal."""

import datetime
import json
import shutil
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.gap_history import reader as stored
from s2rtools.nightly.config import NightlyConfig
from s2rtools.nightly.run import nightly
from s2rtui.cli import main
from tests.support import nights

RESET = datetime.date(1970, 1, 1)


@pytest.fixture
def config(tmp_path: Path, tiny_store: Path) -> NightlyConfig:
    shutil.copytree(tiny_store, tmp_path / "lab.s2r")
    return nights.write_config(tmp_path, tmp_path / "lab.s2r")


@pytest.fixture
def week(config: NightlyConfig) -> nights.Week:
    return nights.Week(config, {}, from_day=99)


def measure_reset_night(week: nights.Week) -> None:
    """A night dated by a reset clock, admitted with `far`."""
    nightly(week.config, RESET, week.measure, week.estimate, nights.clock(), far=True)


def test_far_dates_and_withdrawals_of_missing_nights_are_rejected(week, s2r):
    week.night(1)
    before = week.config.history.read_bytes()
    for date in ("1970-01-01", "2026-09-01"):
        error = s2r("nightly", week.config.source, "--night", date).checked(2).err
        assert f"night {date} is far from the newest, {nights.day(1)}" in error
        assert "--far-night" in error
    for date in ("2026-11-30", "yesterday"):
        s2r("nightly", week.config.source, "--withdraw", date).assert_refused()
    assert week.config.history.read_bytes() == before


def test_a_night_after_a_wrongly_dated_one_is_rejected_with_advice(week):
    measure_reset_night(week)
    with pytest.raises(RequestError, match="--withdraw 1970-01-01"):
        week.night(1)


def test_a_withdrawn_night_stays_recorded_and_no_longer_dates_evidence(week, s2r):
    week.night(1)
    measure_reset_night(week)
    undated = week.night(2, new_log=False)
    assert (undated.night.outcome, undated.night.evidence_since) == ("INCONCLUSIVE", RESET)
    printed = s2r("nightly", week.config.source, "--withdraw", "1970-01-01").printed
    assert "1970-01-01: withdrawn from lab" in printed
    rows = map(json.loads, week.config.history.read_text().splitlines())
    withdrawn = [row for row in rows if row["withdrawn_at"]]
    assert [(row["name"], row["night"]) for row in withdrawn] == [("lab", str(RESET))]
    assert withdrawn[0]["withdrawn_at"].endswith("Z")
    repeated = week.night(2, new_log=False)
    assert repeated.new
    assert (repeated.night.outcome, repeated.night.evidence_since) == ("PASS", nights.day(1))
    history = stored.read(week.config.history)
    assert [night.night for night in history.of_configuration("lab")] == [
        nights.day(1),
        nights.day(2),
    ]
    assert len({night.id for night in history.nights}) == len(history.nights)
    assert not week.night(2, new_log=False).new


def test_latest_refers_to_the_newest_remaining_night_and_no_id_is_used_again(week):
    week.night(1)
    last = week.night(2).night.id
    day = str(nights.day(2))
    assert main(["nightly", str(week.config.source), "--withdraw", day]) == 0
    assert (week.config.reports / "latest").resolve().name == str(nights.day(1))
    assert (week.config.reports / day / "report.json").is_file()
    assert week.night(3).night.id == last + 1
