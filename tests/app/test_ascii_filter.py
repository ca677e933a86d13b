"""ASCII mode: every screen contains only ASCII characters, whatever names the user chose."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from textual.pilot import Pilot

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle, take_screenshot
from s2rtui.canvas import RenderOptions
from s2rtui.session import Session, shared_selection
from s2rtui.terminal.ascii_filter import to_ascii
from s2rtui.user_data.notebook import Notebook


def non_ascii(app: S2RApp) -> set[str]:
    return {char for char in take_screenshot(app).text if ord(char) > 126}


async def press(app: S2RApp, pilot: Pilot[None], *keys: str) -> None:
    for key in keys:
        await pilot.press(key)
        await settle(app, pilot)


@given(st.text())
def test_ascii_text_keeps_the_width_of_the_original(text: str) -> None:
    assert to_ascii(text).isascii()
    assert cell_len(to_ascii(text)) == cell_len(text) or not text.isprintable()


@pytest.mark.parametrize("size", [(80, 24), (200, 60)])
@pytest.mark.parametrize(
    "keys",
    [("f",), ("T",), ("D",), ("question_mark",), ("slash",), ("slash", "ü", "enter"),
     ("3",), ("8",), ("ctrl+c",), ("space",), ("1", "ctrl+c"), ("ctrl+p",)],
)  # fmt: skip
async def test_every_screen_is_ascii(
    tiny_store: Path, size: tuple[int, int], keys: tuple[str, ...]
) -> None:
    session = Session(tiny_store, notebooks=Notebook)
    session.writable_notebook.save(
        "Flur links │ 廊下", shared_selection.current_selection(session.state)
    )
    session.writable_notebook.note(session.state.cursor or 0, "überbelichtet …")
    app = S2RApp(session, RenderOptions(ascii=True))
    app.load_scheduler.debounce_seconds = 0.001
    async with app.run_test(size=size) as pilot:
        await settle(app, pilot)
        await press(app, pilot, *keys)
        assert non_ascii(app) == set()


async def test_ctrl_c_shows_the_key_that_quits(tiny_store: Path) -> None:
    app = S2RApp(Session(tiny_store), RenderOptions())
    async with app.run_test(size=(80, 24)) as pilot:
        await press(app, pilot, "ctrl+c")
        assert "q quits" in take_screenshot(app).text
        assert not app._notifications
