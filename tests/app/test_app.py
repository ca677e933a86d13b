"""The application under a pilot: every size, every key twice, keys while loading, plain ASCII."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from textual.pilot import Pilot
from textual.screen import ModalScreen
from textual.widgets import Input

from s2rtui.app.actions import ACTIONS, footer, help_text, key_label
from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, snapshot, take_screenshot
from s2rtui.app.widgets.plot import PlotView
from s2rtui.canvas import ColourMode, RenderOptions
from s2rtui.canvas.marks import Mark
from s2rtui.session import Brush, Session

SIZES = [(80, 24), (120, 40), (200, 60)]


def make_app(store: Path, look: RenderOptions | None = None, at: Path | None = None) -> S2RApp:
    app = S2RApp(Session(store), look or RenderOptions(), at)
    app.load_scheduler.debounce_seconds = 0.001
    return app


RIGHT_ERRORS = ("missing; add the model again",)
"""What the store of these tests cannot do: its models were never trained."""


async def sound(app: S2RApp, pilot: Pilot[None], key: str) -> None:
    """After a key the application runs, and tells no error that has no reason."""
    await settle(app, pilot)
    state = app.session.state
    assert app.fault is None, key
    assert app.is_running, key
    told = [state.message] if state.is_error else []
    for error in (*told, *app.resources.failed.values()):
        assert any(words in error for words in RIGHT_ERRORS), (key, error)


@pytest.mark.parametrize("size", [SIZES[0], SIZES[-1]])
async def test_every_key_twice(tiny_store: Path, tmp_path: Path, size: tuple[int, int]) -> None:
    app = make_app(tiny_store, at=tmp_path)
    async with app.run_test(size=size) as pilot:
        for action in ACTIONS:
            if action.name == "quit":
                continue
            for key in action.keys:
                await pilot.press(key, key)
                await sound(app, pilot, key)
                while isinstance(app.screen, ModalScreen) or app.prompt.is_open:
                    await pilot.press("escape")
        await sound(app, pilot, "escape")
        assert len(list(tmp_path.glob("s2r-*.png"))) == 2


@pytest.mark.parametrize("size", SIZES)
async def test_keys_while_loading(tiny_store: Path, size: tuple[int, int]) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=size) as pilot:
        await pilot.press("right", "r", "h", "right", "o", "w", "v", "left", "R", "3", "right")
        await settle(app, pilot)
        state = app.session.state
        assert app.resources.pictures is not None
        assert app.resources.pictures.iid == state.cursor


@pytest.mark.parametrize(
    ("size", "views"),
    [
        ((80, 24), {"map"}),
        ((120, 40), {"overview", "map", "instance"}),
        (
            (200, 60),
            {"overview", "umap", "orientation", "rooms", "errors", "map", "instance"},
        ),
    ],
)
async def test_layouts(tiny_store: Path, size: tuple[int, int], views: set[str]) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=size) as pilot:
        await settle(app, pilot)
        seen = {view.id for view in app.query(PlotView) if view.region.area and view.size.height}
        assert seen == views
        for view in app.query(PlotView):
            if view.id in seen:
                assert view.region.right <= size[0]
                assert view.region.bottom <= size[1]


async def test_number_keys_switch_views_on_a_small_screen(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        for key, view in (("1", "overview"), ("3", "instance"), ("2", "map")):
            await pilot.press(key)
            await settle(app, pilot)
            shown = {plot.id for plot in app.query(PlotView) if plot.region.area}
            assert shown == {view}


@pytest.mark.parametrize("size", [(60, 20), (30, 8), (10, 3)])
async def test_small_terminals_do_not_break(tiny_store: Path, size: tuple[int, int]) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=size) as pilot:
        await pilot.press("w", "right", "3", "1")
        await settle(app, pilot)
        text = take_screenshot(app).text
        assert text.strip()


async def test_resizing_changes_the_layout(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(200, 60)) as pilot:
        await settle(app, pilot)
        for size in ((80, 24), (120, 40), (20, 5), (200, 60)):
            await pilot.resize_terminal(*size)
            await settle(app, pilot)
        assert "errors" in take_screenshot(app).text


async def test_an_expression_is_written_corrected_and_applied(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
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


async def test_letters_go_into_the_query_line_while_it_is_open(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("slash")
        app.query_one("#query", Input).value = ""
        await pilot.press("n", "o", "n", "e")
        assert app.query_one("#query", Input).value == "none"
        await pilot.press("enter")
        assert app.session.state.count == "0 of 40"


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("keys", ["", "m,o", "3,v,o,o", "question_mark", "1,slash"])
def test_ascii_is_ascii_everywhere(tiny_store: Path, size: tuple[int, int], keys: str) -> None:
    pressed = [key for key in keys.split(",") if key]
    shot = snapshot(tiny_store, size, pressed, RenderOptions(ascii=True))
    strange = {c for c in shot.text if ord(c) > 126}
    assert strange == set()


@pytest.mark.parametrize("mode", list(ColourMode))
def test_every_colour_mode_shows_the_same_text(tiny_store: Path, mode: ColourMode) -> None:
    text = snapshot(tiny_store, (120, 40), ["w"], RenderOptions(mode=mode)).text
    assert "worst15" in text
    assert "vanilla" in text
    assert "6 of 40" in text


def test_the_same_keys_give_the_same_picture(tiny_store: Path) -> None:
    shots = [
        snapshot(tiny_store, (80, 24), ["w", "right", "3"]).png(RenderOptions()) for _ in range(2)
    ]
    assert shots[0] == shots[1]
    assert shots[0].startswith(b"\x89PNG")


def test_numbers_on_the_screen_are_the_stores(tiny_store: Path) -> None:
    import s2rstore
    from s2rstore.metrics import run_metrics

    text = snapshot(tiny_store, (120, 40), ["c"]).text
    with s2rstore.open(tiny_store) as store:
        for run in store.runs:
            for side in ("sim", "real"):
                accuracy = run_metrics.side_metrics(store, run, side).accuracy.value
                line = next(row for row in text.splitlines()[1:] if f" {run} " in row)
                assert f"{100 * accuracy:.1f}" in line


def test_key_map_footer_and_help_come_from_one_table(tiny_store: Path) -> None:
    state = Session(tiny_store).state
    brush = Brush("map", Mark("map", ((0.0, 0.0), (1.0, 1.0))))
    for situation in (state, replace(state, brush=brush), replace(state, view="list")):
        applying = [action for action in ACTIONS if action.applies(situation)]
        keys = [key for action in applying for key in action.keys]
        assert len(keys) == len(set(keys))
        for width in range(0, 200, 7):
            assert footer(width, situation)[-1][1] == "quit"
    for action in ACTIONS:
        name = action.call.split("(")[0]
        assert hasattr(S2RApp, f"action_{name}"), name
        assert action.description in help_text()


def test_starting_the_application_loads_no_heavy_package(tiny_store: Path) -> None:
    """Nor what asks for graphics, and draws them: so nothing of that reaches the terminal."""
    import subprocess
    import sys

    code = (
        "import sys; from s2rtui import cli; from s2rtui.terminal import capabilities;"
        "from s2rtui.app.app import S2RApp;"
        "capabilities.refuse_unusable = lambda: None; S2RApp.run = lambda app, mouse: print('run');"
        f"assert cli.main(['tui', {str(tiny_store)!r}]) == 0;"
        "print([m for m in ('torch', 'matplotlib', 'zarr', 'scipy', 'cv2', 'PIL', 's2rtools', "
        "'s2rtui.terminal.graphics') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["run", "[]"]


def test_keys_are_shown_as_they_stand_on_a_keyboard() -> None:
    lines = {line.strip() for line in help_text().splitlines()}
    assert any(line.startswith("z  +  =  ") for line in lines)
    for action in ACTIONS:
        for key in action.keys:
            shown = key_label(key)
            assert shown.isascii()
            assert "_" not in shown
            assert len(shown) == 1 or shown.split("+")[-1].replace(" ", "") == key.split("+")[-1]


async def test_escape_is_offered_while_something_is_begun(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        assert "escape cancel" not in take_screenshot(app).text
        for begin in ("x", "vertical_line"):
            await pilot.press(begin)
            await settle(app, pilot)
            assert "escape cancel" in take_screenshot(app).text
            await pilot.press("escape")
            await settle(app, pilot)
            assert "escape cancel" not in take_screenshot(app).text
        await pilot.press("slash", "escape")
        assert not app.prompt.is_open
