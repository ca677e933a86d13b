"""The letters of the jump mode lie on the parts of the status line that they change."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rtui.app.app import S2RApp
from s2rtui.app.pilot import settle
from s2rtui.app.screens.jump import JumpScreen
from s2rtui.app.status_line import Bar
from s2rtui.canvas import RenderOptions
from s2rtui.session import Session
from tests.support.copies import copy_store


@pytest.mark.parametrize("expression", ["all", "traj:a", 'run("dataaug").gap > 0', "none"])
@pytest.mark.parametrize("name", ["s.s2r", "traj all run 所.s2r"])
async def test_jump_letters_lie_on_their_parts_of_the_status_line(
    tiny_store: Path, tmp_path: Path, expression: str, name: str
) -> None:
    session = Session(copy_store(tiny_store, tmp_path / name))
    session.select(expression)
    app = S2RApp(session, RenderOptions())
    async with app.run_test(size=(200, 60)) as pilot:
        await settle(app, pilot)
        await pilot.press("space")
        assert isinstance(app.screen, JumpScreen)
        bar = app.screen_stack[0].query_one("#status", Bar)
        line, padding = bar.render_line(0), bar.styles.padding.left
        targets = {
            target.action: line.crop(target.x - padding, 200).text
            for target in app.screen._targets.values()
            if target.y == 0 and target.action.startswith("do(")
        }
        shown = session.state.expression
        assert targets["do('trajectory')"].startswith("traj all │ ")
        assert targets["do('next_run')"].startswith("run vanilla")
        assert targets["do('edit')"].startswith(f"{shown} │ generation")
