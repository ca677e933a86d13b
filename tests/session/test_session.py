"""The session without a screen: frozen states and transitions."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rtui.session import navigation, view_settings
from s2rtui.session.session import Session


@pytest.fixture
def session(tiny_store: Path) -> Iterator[Session]:
    opened = Session(tiny_store)
    yield opened
    opened.close()


def test_the_count_refers_to_the_chosen_trajectories(session):
    assert session.select("worst15").count_text == "6 of 40"
    session.dispatch(navigation.change_trajectory)
    assert session.state.trajectories == ("a",)
    assert session.state.count_text == "4 of 25"
    session.dispatch(navigation.change_trajectory)
    assert session.state.count_text == "3 of 15"
    session.dispatch(navigation.change_trajectory)
    assert session.state.trajectories is None


def test_heatmap_kinds_modes_and_sides_cycle(session):
    kinds = {session.state.heat.kind}
    for _ in range(5):
        kinds.add(session.dispatch(view_settings.change_heat, 1).heat.kind)
    assert kinds == {"activation", "feature_distance", "occlusion", "none"}
    while session.state.heat.kind != "occlusion":
        session.dispatch(view_settings.change_heat, 1)
    modes = {session.dispatch(view_settings.change_mode).heat.mode for _ in range(3)}
    assert modes == {"rgb", "depth", "rgbd"}
    assert session.dispatch(view_settings.change_side).heat.side == "sim"
    overlays = [session.dispatch(view_settings.change_overlay).overlay for _ in range(4)]
    assert overlays == ["instance", "selection", "run", "off"]


def test_an_uncomputed_run_is_rejected(store_copy):
    with edit(store_copy) as draft:
        draft._connection.execute("UPDATE run SET key = NULL WHERE run = 'dataaug'")
    with pytest.raises(RequestError, match="not computed"):
        Session(store_copy, "dataaug")
    assert Session(store_copy).state.runs == ("vanilla",)
    with edit(store_copy) as draft:
        draft._connection.execute("UPDATE run SET key = NULL")
    state = Session(store_copy).state
    assert (state.run, state.view) == ("", "instance")


def map_plane(session: Session) -> view_settings.ZoomPlane:
    return view_settings.map_plane(session.store, session.state)


def test_zoom_and_pan_are_limited(session):
    bounds = session.store.dataset.bounds
    for _ in range(40):
        session.dispatch(view_settings.zoom, map_plane(session), 1 / 0.6)
    closest = session.state.viewport
    assert closest.width == pytest.approx(bounds.width * view_settings.CLOSEST)
    for _ in range(60):
        session.dispatch(view_settings.pan, map_plane(session), 0.2, -0.2)
    session.dispatch(view_settings.pan, map_plane(session), 500.0, -500.0)
    panned = session.state.viewport
    middle = (panned.x0 + panned.x1) / 2, (panned.y0 + panned.y1) / 2
    assert middle == pytest.approx((bounds.x1, bounds.y0))
    for _ in range(40):
        session.dispatch(view_settings.zoom, map_plane(session), 0.6)
    assert session.state.viewport is None
    session.dispatch(view_settings.zoom, map_plane(session), 0.6)
    assert session.state.viewport is None


def test_a_map_is_zoomed_at_its_middle_where_the_instance_has_no_pose(store_copy):
    with edit(store_copy) as draft:
        draft.rows("UPDATE instance SET x = NULL, y = NULL")
    session = Session(store_copy)
    session.set_cursor(3)
    session.dispatch(view_settings.zoom, map_plane(session), 1 / 0.6)
    viewport = session.state.viewport
    assert np.isfinite([viewport.width, viewport.height, viewport.x0, viewport.y0]).all()


@pytest.mark.parametrize(
    ("cursor", "steps", "expected"),
    [(5, 1, 7), (5, 2, 20), (5, -1, 3), (0, -1, 20), (30, 1, 3), (7, 1, 20), (20, 1, 3)],
)
def test_steps_go_round_the_selection_and_skip_none(session, cursor, steps, expected):
    session.select("ids(3, 7, 20)")
    session.set_cursor(cursor)
    assert session.dispatch(navigation.move_cursor, steps).cursor == expected


def test_sessions_follow_generations_with_the_same_instances(store_copy):
    free, pinned = Session(store_copy), Session(store_copy, generation=2)
    with edit(store_copy) as draft:
        draft.set_provenance("test", {"key": "value"})
    for session, follows in ((free, True), (pinned, False)):
        message, updates = session.state.message, session.read_updates()
        session.apply_updates(updates)
        assert session.follow(updates) is follows
        assert session.state.message == message
        assert (session.state.generation == session.state.newest) is follows
    with edit(store_copy) as draft:  # no run is left, which a session refuses
        for run in free.state.runs:
            draft.update("run", {"run": run}, {"key": None})
    assert not free.follow(free.read_updates())
    assert not free.state.is_error
    free.close()
    pinned.close()
