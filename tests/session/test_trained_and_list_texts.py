"""What `M` says where nothing is to be included, and the headers of the list."""

from __future__ import annotations

from s2rtui.charts.list.view import VIEW
from s2rtui.charts.scene import Resources, Scene
from s2rtui.session import Session, navigation


def test_m_says_that_a_run_has_no_trained_instances(tiny_store):
    session = Session(tiny_store)
    state = session.dispatch(navigation.toggle_trained)
    assert state.message.startswith("nothing to include: ")
    assert "vanilla" in state.message
    assert "\n" not in state.message
    assert "trained" not in state.count
    session.close()


def test_headers_of_the_list_are_fields_with_units(tiny_store):
    session = Session(tiny_store)
    columns = VIEW.input(Scene(session.store, session.state, Resources())).columns
    titles = [column.title for column in columns]
    assert titles[1] == "real.error_m"
    assert {"real.heading_error_deg", "sim.error_m", "gap_m", "shift_m", "heading_deg"} <= {*titles}
    assert all(column.width >= len(column.title) for column in columns if column.right)
    session.close()
