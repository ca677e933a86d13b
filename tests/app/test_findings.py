"""Findings and grouped errors in the application: keys, selections, and several screens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.session import Session
from s2rtui.session.error_groups import COLUMN_NAMES, GROUPINGS
from s2rtui.user_data.notebook import Notebook


def make_app(store: Path) -> S2RApp:
    app = S2RApp(Session(store, notebooks=Notebook), RenderOptions())
    app.load_scheduler.debounce_seconds = 0.001
    return app


async def press(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    for key in keys:
        await pilot.press(key)
        await settle(app, pilot)


@pytest.mark.parametrize("key", ["I", "f1"])
@pytest.mark.parametrize("size", [(80, 24), (120, 40), (200, 60)])
async def test_each_finding_is_one_key_away_from_its_instances(
    tiny_store: Path, size: tuple[int, int], key: str
) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=size) as pilot:
        await settle(app, pilot)
        report = app.resources.findings
        assert report is not None
        for number, finding in enumerate(report.findings):
            await press(app, pilot, key, *["down"] * (number > 0), "enter")
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
        assert app.resources.findings is not None
        for finding in app.resources.findings.findings:
            assert finding.kind in text
        assert "I findings" in text


async def test_the_chosen_finding_wraps_around(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "I", "up")
        assert app.resources.findings is not None
        last = app.resources.findings.findings[-1]
        await press(app, pilot, "enter")
        assert last.text in app.session.state.message


async def test_a_finding_is_about_all_trajectories(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "t", "I", "enter")
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


@pytest.mark.parametrize("grouping", range(1, len(GROUPINGS)))
async def test_every_grouping_can_be_brushed(tiny_store: Path, grouping: int) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(app, pilot, "c", "6", *["O"] * grouping, "x", "enter")
        state = app.session.state
        assert not state.is_error
        assert state.expression != "all"
        other = Session(tiny_store).select(state.expression).selected
        assert np.array_equal(other, state.selected)


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
