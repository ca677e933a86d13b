"""A flood of mouse moves is told as few strokes, which lack nothing of the way."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from textual import events

from s2rtui.app import S2RApp
from s2rtui.canvas import Look
from s2rtui.headless import settle
from s2rtui.session import Session
from s2rtui.widgets import PlotView
from s2rtui.widgets.plot import Drag, Stroke

MOVES = 300


async def test_moves_never_queue_up(tiny_store: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    strokes: list[Stroke] = []
    taken = PlotView.Dragged.taken

    def slowly(message: PlotView.Dragged) -> Stroke:
        strokes.append(taken(message))
        time.sleep(0.02)
        return strokes[-1]

    monkeypatch.setattr(PlotView.Dragged, "taken", slowly)
    app = S2RApp(Session(tiny_store), Look())
    async with app.run_test(size=(120, 40)) as pilot:
        await settle(app, pilot)
        plot = app.query_one("#map", PlotView)
        await pilot.mouse_down("#map", offset=(20, 10))
        cells = [(20 + n % 2, 10 + n % 7) for n in range(MOVES)]
        for x, y in cells:
            plot.post_message(events.MouseMove(plot, x, y, 0, 0, 1, False, False, False, x, y))
        await pilot.pause()
        await pilot.mouse_up("#map", offset=(40, 20))
        await settle(app, pilot)
    assert len(strokes) < MOVES / 10
    assert [stroke.done for stroke in strokes] == [False] * (len(strokes) - 1) + [True]
    last = strokes[-1]
    assert last.start == (20, 10)
    assert last.trail[-1] == (40, 20)
    assert set(cells) <= {last.start, *last.trail}
    assert app.session.state.expression.startswith("box(")


def test_a_stroke_is_told_once_until_it_is_taken() -> None:
    drag = Drag("map", (1, 1))
    assert not drag.move((1, 1))
    assert drag.move((2, 1))
    assert drag.to_tell()
    assert drag.move((3, 1))
    assert not drag.to_tell()
    assert drag.taken() == Stroke("map", (1, 1), ((2, 1), (3, 1)), False)
    drag.end()
    assert drag.to_tell()
    assert drag.taken().done
