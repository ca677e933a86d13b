"""Small terminals: the most important parts come first, and texts are shown completely."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from s2rstore.language.syntax_tree import Saved
from s2rtools.common.command_line.output import table
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.app.screens.doctor import DoctorScreen
from s2rtui.app.status_line import status_line
from s2rtui.app.titled_view import _divided, truncated
from s2rtui.canvas import ColourMode, RenderOptions
from s2rtui.charts.registry import VIEWS
from s2rtui.session.session import Session
from s2rtui.terminal.capabilities import detect
from tests.support import tiny
from tests.support.application import press, running


@pytest.fixture(scope="module")
def session(tiny_store: Path) -> Session:
    return Session(tiny_store)


@given(st.integers(20, 200), st.booleans(), st.booleans(), st.integers(1, 90))
def test_the_status_line_fits_and_keeps_count_and_expression(
    session, width, newer, narrowed, length
):
    state = replace(
        session.state,
        newest=session.state.generation + newer,
        trajectories=("所有",) if narrowed else None,
        node=Saved("x" * length),
    )
    head, text, tail = status_line(session.store, state, width, RenderOptions())
    assert state.count_text in head
    assert f"@{'x' * length}".startswith(text.rstrip("…"))
    assert cell_len(head + text + tail) <= max(width - 2, len(state.count_text) + 3 + 8)
    if width >= 40:
        assert len(text) >= min(length, 20)
    for part in ("run vanilla", "traj 所有" if narrowed else "run vanilla"):
        if width >= 60:
            assert part in head


def test_the_status_line_drops_the_least_important_parts_first(session):
    state = replace(session.state, node=Saved("x" * 19), newest=session.state.generation + 1)
    lines = [
        "".join(status_line(session.store, state, width, RenderOptions()))
        for width in range(30, 120)
    ]
    parts = ("traj all", "tiny.s2r", "available, press g", "run vanilla")
    first = [next(i for i, line in enumerate(lines) if part in line) for part in parts]
    assert first == sorted(first, reverse=True)
    assert len(set(first)) == len(first)


@pytest.mark.parametrize("size", [(40, 12), (80, 24)])
async def test_long_errors_are_shown_completely(tiny_store, size):
    async with running(tiny_store, size=size) as (app, pilot):
        message = "a long story " * (6 if size[0] == 40 else 12) + "with an end"
        app.session.show_message(message, is_error=True)
        app.updater.refresh()
        await settle(app, pilot)
        text = " ".join(take_screenshot(app).text.split())
        assert message in text
        assert "quit" in text
        await press(app, pilot, "escape")
        assert "story" not in take_screenshot(app).text
        assert app.query_one("#message").size.height == 1


@pytest.mark.parametrize("size", [(40, 12), (200, 60)])
async def test_the_diagnostics_can_be_scrolled_to_the_end(tiny_store, size):
    app = S2RApp(Session(tiny_store), RenderOptions(mode=ColourMode.NONE))
    app.terminal = detect("auto", False, {"TERM": "vt100", "LANG": "C.UTF-8"})
    async with app.run_test(size=size) as pilot:
        await press(app, pilot, "D")
        pages = [take_screenshot(app).text]
        while len(pages) < 2 or pages[-1] != pages[-2]:
            await press(app, pilot, "pagedown")
            pages.append(take_screenshot(app).text)
        text = " ".join("".join(pages).split())
        assert "no colours" in text
        assert "no colour by TERM=vt100" in text
        assert "NO_COLOR" not in text
        assert "wrong colours:" in text
        await pilot.resize_terminal(100, 30)
        await settle(app, pilot)
        assert "100x30" in take_screenshot(app).text
        await pilot.press("escape")
        assert not isinstance(app.screen, DoctorScreen)


def test_titles_and_tables_count_cells():
    for width in range(8, 24):
        assert cell_len(truncated("所有世界 is 12.5 m", width, RenderOptions())) <= width
        assert cell_len(_divided("所有 世界 所有 世界 所有 世界", width)[0]) <= width
    lines = table(["name", "value"], [["所有世界", 1], ["all", 12]]).splitlines()
    assert {cell_len(line) for line in lines} == {15}


SCREENS = Path(__file__).parent / "screens"
STORED = [
    path for path in sorted(SCREENS.glob("*.txt"))
    if path.name.split("-")[0] in {"trained", *(view.name for view in VIEWS)}
]  # fmt: skip


def test_no_stored_screen_of_a_view_has_a_cut_text():
    assert len(STORED) > 60
    for path in STORED:
        text = path.read_text(encoding="utf-8")
        assert ("~" if "ascii" in path.name else "…") not in text, path.name


async def test_a_small_screen_has_no_cut_text(tmp_path):
    async with running(tiny.build(tmp_path / "half.s2r", trained=("vanilla",)), size=(60, 20)) as (
        app,
        pilot,
    ):
        for population in ("c", "M"):
            await press(app, pilot, population)
            for view in VIEWS:
                if view.from_store:
                    await press(app, pilot, view.key)
                    assert "…" not in take_screenshot(app).text, view.name
            for mode in ("m", "m", "m"):
                await press(app, pilot, "2", mode)
                assert "…" not in take_screenshot(app).text, mode


async def test_a_long_title_has_a_second_line_and_the_mouse_still_hits(tiny_store):
    async with running(tiny_store, size=(60, 20)) as (app, pilot):
        await press(app, pilot, "c", "8")
        assert app.updater.title_rows("list") == 1
        await press(app, pilot, "full_stop", "full_stop", "full_stop", "full_stop")
        assert app.session.state.sort == "real.heading_error"
        lines = take_screenshot(app).text.splitlines()
        assert app.updater.title_rows("list") == 2
        assert "by real.heading_error_deg" in " ".join(lines[1:3])
        first = int(lines[4].replace("▶", " ").split()[0])
        await pilot.click("#list", offset=(8, 3))
        await press(app, pilot)
        await pilot.pause()
        assert app.session.state.cursor == first
