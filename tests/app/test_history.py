"""The gap history in the application: view, outputs and updates after new nights."""

import asyncio
from dataclasses import replace
from pathlib import Path

import pytest

from s2rstore.gap_history import reader
from s2rtui.app.pilot import settle, snapshot, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.scene import LoadedData, Scene
from s2rtui.cli import main
from s2rtui.session.session import Session
from tests.app.test_screen_snapshots import check
from tests.support import gaps, nights
from tests.support.application import press, running
from tests.support.copies import copy_store

VIEW = BY_NAME["history"]


def store_with_nights(folder: Path, store: Path, days: int, good_days: int) -> nights.Week:
    """A copy of the store with nights; the task gap grows after some good days."""
    config = nights.write_config(folder, copy_store(store, folder / "tiny.s2r"))
    week = nights.Week(config, {"task": 20.0}, from_day=good_days + 1)
    for number in range(1, days + 1):
        week.night(number)
    return week


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory, tiny_store: Path) -> Path:
    """A store with a week of nights that no test modifies."""
    return store_with_nights(tmp_path_factory.mktemp("nights"), tiny_store, 7, 4).config.store


async def test_screens(store):
    async with running(store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "G")
        for size in ((80, 24), (120, 40), (200, 60)):
            await pilot.resize_terminal(*size)
            await settle(app, pilot)
            check(f"history-week-{size[0]}x{size[1]}", take_screenshot(app).text)


async def test_an_added_night_appears_in_the_view(tmp_path, tiny_store):
    week = store_with_nights(tmp_path, tiny_store, 2, 2)
    async with running(week.config.store) as (app, pilot):
        await press(app, pilot, "G")
        before = take_screenshot(app).text
        await asyncio.to_thread(week.night, 3)
        app.store_updates.check_store()
        await settle(app, pilot)
        after = take_screenshot(app).text
    assert "2 nights of lab" in before
    assert "● pass" in before.splitlines()[2]
    assert "3 nights of lab" in after
    assert "▲ fail" in after.splitlines()[2]


def test_a_damaged_history_is_reported_and_other_views_work(tmp_path, tiny_store):
    copy_store(tiny_store, tmp_path / "s.s2r")
    path = reader.history_path(tmp_path / "s.s2r")
    path.parent.mkdir()
    path.write_bytes(b"no database")
    text = snapshot(tmp_path / "s.s2r", (200, 24)).text
    assert "gap.jsonl: no history that this version reads" in text
    shown = snapshot(tmp_path / "s.s2r", (80, 24), ["G"]).text.splitlines()[2:8]
    assert shown[0].strip() == "the history cannot be read"
    assert str(path) in "".join(line.strip() for line in shown)
    assert main(["show", str(tmp_path / "s.s2r"), "history"]) == 2
    assert main(["show", str(tmp_path / "s.s2r"), "errors"]) == 0


def test_exported_numbers_equal_the_history(store, s2r):
    rows = s2r("show", store, "history", "--json").json
    nights_read = reader.read(reader.history_path(store)).of_configuration("lab")
    assert [row["outcome"] for row in rows if row["axis"] == "headline"] == (
        ["PASS"] * 4 + ["FAIL"] * 3
    )
    for night in nights_read:
        shown = {row["axis"]: row for row in rows if row["night"] == str(night.night)}
        assert shown["headline"]["G"] == night.gap.value
        assert all(shown[axis.axis]["low"] == axis.gap.low for axis in night.axes[:3])
        assert (shown["delay"]["result"], shown["delay"]["G"]) == ("absent", None)
    summary = s2r("show", store, "history", "--words").printed
    assert "Night 2026-11-22: FAIL" in summary
    assert "worst axis task; 4 of 7 nights passed; evidence is 0 days old." in summary


def test_a_history_is_exported_and_an_empty_one_is_rejected(store, tiny_store, tmp_path, s2r):
    out = tmp_path / "history.png"
    arguments = ["--view", "history", "--out", str(out)]
    assert main(["export", str(store), *arguments]) == 0
    assert out.read_bytes().startswith(b"\x89PNG")
    s2r("export", tiny_store, *arguments).assert_refused("no nights yet; s2r nightly CONFIG.toml")


def test_the_history_option_reads_another_file(store, tiny_store, s2r):
    arguments = ["show", str(tiny_store), "history", "--words", "--history"]
    assert "Night 2026-11-22" in s2r(*arguments, reader.history_path(store)).printed
    s2r(*arguments, "none.duckdb").assert_refused("--history none.duckdb: no such file")


def test_a_restricted_session_reads_only_its_own_history(store, tiny_store, s2r, monkeypatch):
    monkeypatch.setattr("s2rtui.terminal.capabilities.refuse_unusable", lambda **options: None)
    other = str(reader.history_path(store))
    s2r("tui", tiny_store, "--restricted", "--history", other).assert_refused(
        "a restricted session shows only the history of the store"
    )


@pytest.mark.parametrize(
    ("loaded", "expected"),
    [
        (None, "no nights yet"),
        (gaps.history(*gaps.week(run="dataaug")), "there are nights of: dataaug"),
        (gaps.history(*gaps.week(dataset="other")), "name another history"),
    ],
)
def test_missing_nights_are_explained(tiny_store, loaded, expected):
    session = Session(tiny_store)
    scene = Scene(session.store, session.state, LoadedData(history=loaded))
    text = "\n".join(VIEW.draw(scene, (60, 10), RenderOptions()).lines())
    assert expected in text
    assert expected.capitalize() in VIEW.summary(scene) or expected in VIEW.summary(scene)
    assert VIEW.numbers(scene)[1] == []
    session.close()


def test_a_history_is_that_of_the_last_gate_of_a_run_on_any_recording():
    later = gaps.night(8, {"task": 3.0}, name="weekly")
    loaded = gaps.history(*gaps.week(), later)
    assert loaded.of_run("vanilla", "tiny") == (later,)
    repeated = replace(gaps.week()[-1], id=9, outcome="PASS")
    assert gaps.history(*gaps.week(), repeated).of_run("vanilla", "tiny")[-1].id == 9
    days = [replace(night, dataset_hash=f"{night.id:064d}") for night in gaps.week()]
    loaded = gaps.history(*days)
    assert loaded.of_run("vanilla", "tiny") == tuple(days)
    assert loaded.runs("tiny") == ("vanilla",)
    assert loaded.of_run("vanilla", "other") == loaded.runs("other") == ()
