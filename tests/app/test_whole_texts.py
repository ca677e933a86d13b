"""Titles, legends and messages are shown completely at every usual size."""

from __future__ import annotations

from pathlib import Path

from s2rtui.app.pilot import take_screenshot
from s2rtui.charts.registry import VIEWS
from tests.support import tiny
from tests.support.application import make_app, press

SCREENS = Path(__file__).parent / "screens"
STORED = [
    path for path in sorted(SCREENS.glob("*.txt"))
    if path.name.split("-")[0] in {"trained", *(view.name for view in VIEWS)}
]  # fmt: skip


def test_no_stored_screen_of_a_view_has_a_cut_text() -> None:
    assert len(STORED) > 60
    for path in STORED:
        text = path.read_text(encoding="utf-8")
        assert ("~" if "ascii" in path.name else "…") not in text, path.name


async def test_a_small_screen_has_no_cut_text(tmp_path: Path) -> None:
    app = make_app(tiny.build(tmp_path / "half.s2r", trained=("vanilla",)))
    async with app.run_test(size=(60, 20)) as pilot:
        for population in ("c", "M"):
            await press(app, pilot, population)
            for view in VIEWS:
                if view.from_store:
                    await press(app, pilot, view.key)
                    assert "…" not in take_screenshot(app).text, view.name
            for mode in ("m", "m", "m"):
                await press(app, pilot, "2", mode)
                assert "…" not in take_screenshot(app).text, mode


async def test_long_messages_are_wrapped(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(60, 20)) as pilot:
        await press(app, pilot, "2")
        text = "a message of many words " * 4 + "that ends here"
        app.session.show_message(text)
        app.renderer.refresh()
        await press(app, pilot)
        await pilot.pause()
        assert " ".join(text.split()) in " ".join(take_screenshot(app).text.split())


async def test_a_long_title_has_a_second_line_and_the_mouse_still_hits(tiny_store: Path) -> None:
    app = make_app(tiny_store)
    async with app.run_test(size=(60, 20)) as pilot:
        await press(app, pilot, "c", "8")
        assert app.renderer.title_rows("list") == 1
        await press(app, pilot, "full_stop", "full_stop", "full_stop", "full_stop")
        assert app.session.state.sort == "real.heading_error"
        lines = take_screenshot(app).text.splitlines()
        assert app.renderer.title_rows("list") == 2
        assert "by real.heading_error_deg" in " ".join(lines[1:3])
        first = int(lines[4].replace("▶", " ").split()[0])
        await pilot.click("#list", offset=(8, 3))
        await press(app, pilot)
        await pilot.pause()
        assert app.session.state.cursor == first
