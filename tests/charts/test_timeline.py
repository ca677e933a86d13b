"""The timeline view: errors in the order of a trajectory, gaps, ranges, and playing."""

import numpy as np
import pytest

import s2rstore
from s2rtui.app.controllers.player import SPEEDS
from s2rtui.canvas import BrushShape, RenderOptions
from s2rtui.charts.timeline import VIEW, timeline
from s2rtui.export.load_scene import load_scene
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import ReadNotebook
from tests.support.application import press, running

SIZE = (80, 20)


def test_numbers_are_those_of_the_trajectory_by_seq(tiny_store, s2r):
    rows = s2r("show", tiny_store, "timeline", "--iid", "30", "--json").json
    with s2rstore.open(tiny_store) as store:
        truth, columns = store.instances, store.run_columns("vanilla")
        iids = np.flatnonzero(truth.trajectory == truth.trajectory[30])
        iids = iids[np.argsort(truth.seq[iids])]
        expected = columns.real.error[iids]
        assert [row["iid"] for row in rows] == iids.tolist()
        assert [row["seq"] for row in rows] == truth.seq[iids].tolist()
    assert [row["real_error_m"] for row in rows] == pytest.approx(expected.tolist())


def test_lines_end_where_the_recording_has_a_gap():
    seq = np.array([4, 0, 1, 2, 9, 10, 3])
    errors = np.arange(7.0)
    everywhere = np.ones(7, dtype=np.bool_)
    zeros = np.zeros(7, dtype=np.int64)
    found = timeline("a", 0, zeros, seq, errors, errors, errors, everywhere)
    assert found.iids.tolist() == [1, 2, 3, 6, 0, -1, 4, 5]
    assert np.isnan(found.errors["real"][5])
    assert np.array_equal(found.errors["real"][[0, 4, 6]], errors[[1, 0, 4]])


def test_a_marked_range_selects_the_instances_of_the_trajectory(tiny_store):
    session = Session(tiny_store, notebooks=ReadNotebook)
    session.set_cursor(30)
    scene = load_scene(session, VIEW)
    (panel,) = VIEW.panels(scene, SIZE, RenderOptions())
    trajectory = session.store.instances.trajectory
    mark = BrushShape(panel.name, ((1.6, 0.0), (6.4, 1.0)))
    session.select(VIEW.to_expression(scene, panel, mark))
    selected = np.flatnonzero(session.state.selected)
    assert (trajectory[selected] == trajectory[30]).all()
    assert session.store.instances.seq[selected].tolist() == [2, 3, 4, 5, 6]
    VIEW.click(session, scene, panel, (3.2, 0.5))
    assert session.store.instances.seq[session.state.cursor] == 3


async def test_playing_goes_to_the_last_instance_and_stops(tiny_store):
    async with running(tiny_store, size=(80, 24)) as (app, pilot):
        await press(app, pilot, "c", "home", "apostrophe")
        assert "playing 2 steps a second" in app.session.state.message
        await press(app, pilot, "end")
        last = app.session.state.cursor
        app.player.step()  # as the timer does, from the last instance
        assert app.session.state.cursor == last
        await press(app, pilot, "home", "apostrophe")
        app.player.step()
        assert "playing 2 steps a second" in app.session.state.message
        await press(app, pilot, "escape")
        assert "stopped" in app.session.state.message
        assert not app.player.is_playing
        messages = []
        for _ in range(len(SPEEDS) + 1):  # no timer runs between these
            app.player.change_speed()
            messages.append(app.session.state.message)
        assert "playing 2 steps" in messages[0]  # it had stopped at the last instance
        assert "stopped" in messages[-1]
