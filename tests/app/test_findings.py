"""Findings and grouped errors in the application: keys, selections, and several screens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.session import Session
from s2rtui.session.error_groups import COLUMN_NAMES, GROUPINGS
from tests.support.application import make_app, press


async def test_each_finding_is_one_key_away_from_its_instances(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await settle(app, pilot)
        report = app.resources.findings
        assert report is not None
        for number, finding in enumerate(report.findings):
            await press(app, pilot, "I", *["down"] * (number > 0), "enter")
            state = app.session.state
            assert not state.is_error
            assert state.run == finding.run
            assert finding.text in state.message
            if finding.grouping is not None:
                assert state.grouping == finding.grouping
            if finding.expression is not None:
                assert state.expression == finding.expression
                assert np.count_nonzero(state.selected) == finding.n
            if state.run != report.run:
                await press(app, pilot, "R")


async def test_the_first_wide_screen_shows_the_findings(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(200, 60)) as pilot:
        await settle(app, pilot)
        text = " ".join(take_screenshot(app).text.split())
        report = app.resources.findings
        assert report is not None
        assert all(finding.kind in text for finding in report.findings)
        assert "I findings" in text
        await press(app, pilot, "f1", "enter")
        assert report.findings[0].text in app.session.state.message


async def test_the_chosen_finding_wraps_around_and_is_about_all_trajectories(
    tiny_store: Path,
) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "t", "I", "up")
        assert app.session.state.trajectories is not None
        assert app.resources.findings is not None
        last = app.resources.findings.findings[-1]
        await press(app, pilot, "enter")
        assert last.text in app.session.state.message
        assert app.session.state.trajectories is None


async def test_the_rooms_view_groups_and_sorts_by_keys(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "6")
        for grouping in (*GROUPINGS[1:], GROUPINGS[0]):
            await press(app, pilot, "O")
            assert app.session.state.grouping == grouping
        sort = app.session.state.sort
        for name in (*COLUMN_NAMES[1:], COLUMN_NAMES[0]):
            await press(app, pilot, "full_stop")
            assert app.session.state.group_sort == name
            assert app.session.state.sort == sort
        before = take_screenshot(app).text
        await press(app, pilot, "comma")
        assert not app.session.state.group_descending
        assert take_screenshot(app).text != before
        await press(app, pilot, "8", "full_stop")
        assert app.session.state.sort != sort


async def test_every_grouping_can_be_brushed(tiny_store: Path) -> None:
    app, other = make_app(tiny_store), Session(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "6")
        for grouping in GROUPINGS[1:]:
            await press(app, pilot, "c", "O", "x", "enter")
            state = app.session.state
            assert state.grouping == grouping
            assert not state.is_error, grouping
            assert state.expression != "all", grouping
            selected = other.select(state.expression).selected
            assert np.array_equal(selected, state.selected), grouping
    other.close()


async def test_trained_instances_are_ranked_only_if_they_are_included(trained_split: Path) -> None:
    app = make_app(trained_split)
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "6")
        loaded = app.resources.current_groups(app.session.state)
        assert loaded is not None
        assert sum(row.n for row in loaded.rows) == 8
        assert "32 trained on included" not in take_screenshot(app).text
        await press(app, pilot, "M")
        loaded = app.resources.current_groups(app.session.state)
        assert loaded is not None
        assert sum(row.n for row in loaded.rows) == 40
        assert "32 trained on included" in take_screenshot(app).text


@pytest.fixture(scope="module")
def trained_split(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from tests.support import tiny

    return tiny.build(tmp_path_factory.mktemp("split") / "s.s2r", trained=("vanilla",))
