"""ASCII mode: every screen contains only ASCII characters, whatever names the user chose."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.session import Session, shared_selection
from s2rtui.terminal.ascii_filter import to_ascii
from tests.support.application import make_app, press


def non_ascii(app: S2RApp) -> set[str]:
    return {char for char in take_screenshot(app).text if ord(char) > 126}


@given(st.text())
def test_ascii_text_keeps_the_width_of_the_original(text: str) -> None:
    assert to_ascii(text).isascii()
    assert cell_len(to_ascii(text)) == cell_len(text) or not text.isprintable()


async def test_every_screen_is_ascii(tiny_store: Path) -> None:
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


async def test_ctrl_c_shows_the_key_that_quits(tiny_store: Path) -> None:
    app = S2RApp(Session(tiny_store), RenderOptions())
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "ctrl+c")
        assert "q quits" in take_screenshot(app).text
        assert not app._notifications
