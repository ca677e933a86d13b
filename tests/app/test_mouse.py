"""Mouse events are coalesced without losing positions or wheel steps."""

import time

import pytest
from textual import events

from s2rtui.app.pilot import settle
from s2rtui.app.widgets.plot import PlotView, Wheel
from s2rtui.charts.registry import BY_NAME
from s2rtui.session import view_settings
from tests.support.application import press, running

MOVES = 300


async def test_a_mark_applied_by_a_key_is_not_applied_again(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await pilot.press("w")
        await pilot.mouse_down("#map", offset=(4, 4))
        await pilot.hover("#map", offset=(40, 30))
        await press(app, pilot, "ampersand")
        combined = app.session.state.expression
        assert combined.startswith("worst15 & box(")
        await pilot.hover("#map", offset=(50, 30))
        await pilot.mouse_up("#map", offset=(50, 30))
        await settle(app, pilot)
        assert app.session.state.expression == combined
        assert app.session.state.brush is None


async def test_a_drag_moves_one_slider_while_the_sliders_scroll(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "a")
        count = len(app.session.state.adjust.sliders)
        await pilot.resize_terminal(80, 15)
        await pilot.press(*["down"] * (count - 1))
        await settle(app, pilot)
        panel = app.brush.panels(BY_NAME["adjust"])[0]
        assert int(panel.name) > 0
        before = dict(app.session.state.adjust.values)
        x, y = panel.x + panel.width // 4, panel.y + 1
        await pilot.mouse_down("#adjust", offset=(x, y))
        for column in range(x + 1, x + 6):
            await pilot.hover("#adjust", offset=(column, y))
            await settle(app, pilot)
        await pilot.mouse_up("#adjust", offset=(x + 6, y))
        await settle(app, pilot)
        after = dict(app.session.state.adjust.values)
        moved = [key for key in before if before[key] != after[key]]
        assert moved == [app.session.state.adjust.sliders[int(panel.name)].key]


async def test_sliders_and_findings_cannot_be_brushed(tiny_store):
    async with running(tiny_store) as (app, pilot):
        await press(app, pilot, "a")
        await pilot.press("x")
        assert app.session.state.message.startswith("nothing to brush in adjust")
        await pilot.press("enter")
        assert app.session.state.brush is None
        await press(app, pilot, "I")
        await pilot.mouse_down("#findings", offset=(5, 2))
        await pilot.hover("#findings", offset=(30, 9))
        await pilot.mouse_up("#findings", offset=(40, 12))
        await settle(app, pilot)
        assert app.is_running
        assert app.session.state.brush is None


async def test_wheel_events_are_coalesced(tiny_store, monkeypatch):
    turns: list[int] = []
    take_steps = Wheel.take_steps

    def slow_steps(wheel: Wheel) -> int:
        turns.append(take_steps(wheel))
        time.sleep(0.02)
        return turns[-1]

    monkeypatch.setattr(Wheel, "take_steps", slow_steps)
    async with running(tiny_store) as (app, pilot):
        plot = app.query_one("#map", PlotView)
        for _ in range(MOVES):
            turn = events.MouseScrollUp(plot, 20, 10, 0, -1, 0, False, False, False, 20, 10)
            plot.post_message(turn.stop())
        await settle(app, pilot)
        assert len(turns) < MOVES / 10
        assert sum(turns) == MOVES
        view, bounds = app.session.state.viewport, app.session.store.dataset.bounds
        assert max(view.width / bounds.width, view.height / bounds.height) == pytest.approx(
            view_settings.CLOSEST
        )
