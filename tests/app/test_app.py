"""The application in Textual's test pilot: sizes, all keys, colour modes, ASCII output."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from textual.pilot import Pilot
from textual.screen import ModalScreen
from textual.widgets import Input

from s2rtui.app.action import key_label
from s2rtui.app.app import S2RApp
from s2rtui.app.key_bindings import ACTIONS, footer
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.app.screens.help_content import help_lines
from s2rtui.app.widgets.plot import PlotView
from s2rtui.canvas import RenderOptions
from s2rtui.canvas.marks import BrushShape
from s2rtui.session import shared_selection
from s2rtui.session.session import Session
from s2rtui.session.state import Brush
from s2rtui.terminal.strips import to_ascii
from tests.support.application import make_app, press, running

SIZES = ((80, 24), (200, 60))
EXPECTED_ERRORS = ("missing; add the model again",)
"""Errors that are expected, because the models of the test store were never trained."""


async def check_running(app: S2RApp, pilot: Pilot[None], key: str) -> None:
    """After a key the application runs and shows only expected errors."""
    await settle(app, pilot)
    state = app.session.state
    assert app.fault is None, key
    assert app.is_running, key
    shown_errors = [state.message] if state.is_error else []
    for error in (*shown_errors, *app.loaded.failed.values()):
        assert any(expected in error for expected in EXPECTED_ERRORS), (key, error)


@pytest.mark.parametrize(
    ("size", "times"),
    [((80, 24), 1), *(pytest.param(size, 2, marks=pytest.mark.deep) for size in SIZES)],
)
async def test_pressing_every_key_causes_no_error(tiny_store, tmp_path, size, times):
    async with running(tiny_store, folder=tmp_path, size=size) as (app, pilot):
        for action in ACTIONS:
            if action.name == "quit":
                continue
            for key in action.keys:
                await pilot.press(*[key] * times)
                await check_running(app, pilot, key)
                while isinstance(app.screen, ModalScreen) or app.prompt.is_open:
                    await pilot.press("escape")
        await check_running(app, pilot, "escape")
        assert len(list(tmp_path.glob("s2r-*.png"))) == times


async def test_number_keys_switch_views_on_small_screens(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        for size in ((80, 24), (60, 20), (30, 8), (10, 3)):
            await pilot.resize_terminal(*size)
            await pilot.press("w", "right")
            for key, view in (("1", "overview"), ("3", "instance"), ("2", "map")):
                await press(app, pilot, key)
                assert take_screenshot(app).text.strip()
                shown = {plot.id for plot in app.query(PlotView) if plot.region.area}
                assert shown == {view} or size[1] < 20, size


async def test_an_invalid_expression_can_be_corrected_in_the_query_line(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await pilot.press("c", "slash")
        query = app.query_one("#query", Input)
        query.value = "worst15 & room:rihgt"
        await pilot.press("enter")
        await pilot.pause()
        assert "column 16" in app.session.state.message
        assert app.focused is query
        assert query.cursor_position == 15
        assert app.session.state.expression == "all"
        query.value = "worst15 & room:right"
        await pilot.press("enter")
        await pilot.pause()
        assert app.session.state.expression == "worst15 & room:right"
        assert app.focused is None
        assert "worst15 & room:right" in take_screenshot(app).text
        await pilot.press("slash", "escape", "w")
        await pilot.pause()
        assert app.session.state.expression == "worst15"
        await pilot.press("slash", "ctrl+u", *"none")
        assert query.value == "none"


def test_bindings_footer_and_help_use_the_same_actions(tiny_store):
    state = Session(tiny_store).state
    brush = Brush("map", BrushShape("map", ((0.0, 0.0), (1.0, 1.0))))
    for current in (state, replace(state, brush=brush), replace(state, view="list")):
        applicable = [action for action in ACTIONS if action.applies(current)]
        keys = [key for action in applicable for key in action.keys]
        assert len(keys) == len(set(keys))
        for width in range(0, 200, 7):
            assert footer(width, current)[-1][1] == "quit"
    for action in ACTIONS:
        name = action.call.split("(")[0]
        assert hasattr(S2RApp, f"action_{name}"), name
        assert action.description in "\n".join(help_lines())


def test_starting_the_application_loads_no_heavy_package(tiny_store):
    """Nor does it import the terminal graphics, which would write queries to the terminal."""
    import subprocess
    import sys

    code = (
        "import sys; from s2rtui import cli; from s2rtui.terminal import capabilities;"
        "from s2rtui.app.app import S2RApp;"
        "capabilities.refuse_unusable = lambda: None; S2RApp.run = lambda app, mouse: print('run');"
        f"assert cli.main(['tui', {str(tiny_store)!r}]) == 0;"
        "print([m for m in ('torch', 'matplotlib', 'zarr', 'scipy', 'cv2', 'PIL', "
        "'s2rtui.terminal.graphics') if m in sys.modules], {m.split('.')[1] for m in sys.modules "
        "if m.startswith('s2rtools.')})"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert process.stdout.split() == ["run", "[]", "{'common'}"]


def test_key_labels_match_the_keyboard():
    lines = {line.strip() for line in "\n".join(help_lines()).splitlines()}
    assert any(line.startswith("z  +  =  ") for line in lines)
    for action in ACTIONS:
        for key in action.keys:
            label = key_label(key)
            assert label.isascii()
            assert "_" not in label[1:]
            assert len(label) == 1 or label.split("+")[-1].replace(" ", "") == key.split("+")[-1]


def non_ascii(app: S2RApp) -> set[str]:
    return {char for char in take_screenshot(app).text if ord(char) > 126}


@given(st.text())
def test_ascii_text_keeps_the_width_of_the_original(text):
    assert to_ascii(text).isascii()
    assert cell_len(to_ascii(text)) == cell_len(text) or not text.isprintable()


async def test_every_screen_is_ascii(tiny_store):
    app = make_app(tiny_store, RenderOptions(ascii=True))
    session = app.session
    session.writable_notebook.save(
        "Flur links │ 廊下", shared_selection.current_selection(session.state)
    )
    session.writable_notebook.note(session.state.cursor or 0, "überbelichtet …")
    async with app.run_test(size=(120, 40)) as pilot:
        for keys in (
            ("f",), ("T",), ("D",), ("question_mark",), ("slash",), ("slash", "ü", "enter"),
            ("3",), ("3", "v", "o", "o"), ("m", "o"), ("8",), ("ctrl+c",), ("space",),
            ("1", "ctrl+c"), ("ctrl+p",),
        ):  # fmt: skip
            await press(app, pilot, *keys)
            assert non_ascii(app) == set(), keys
            if app.screen is not app.default_screen or app.prompt.is_open:
                await press(app, pilot, "escape")


async def test_ctrl_c_shows_the_key_that_quits(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "ctrl+c")
        assert "q quits" in take_screenshot(app).text
        assert not app._notifications
