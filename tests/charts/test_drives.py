"""The drives view: distances of two logs, moments, and stores without drives."""

from dataclasses import replace
from pathlib import Path

import pytest

from s2rtools.gap.dynamics.ape_rpe import DEFAULT_STEP, NO_ALIGNMENT, drive_errors
from s2rtools.motion_logs.drives import read_drives
from s2rtui.charts.drives import NAMES, STEP, VIEW
from s2rtui.export.load_scene import load_scene
from s2rtui.session.session import Session
from s2rtui.user_data.notebook import ReadNotebook
from tests.support.copies import copy_store
from tests.support.drives import RADII, add_drives


@pytest.fixture
def store(tiny_store: Path, tmp_path: Path) -> Path:
    path = copy_store(tiny_store, tmp_path / "s.s2r")
    add_drives(path)
    return path


def test_figures_are_those_of_the_dynamics_axis(store, s2r):
    rows = {row["drive"]: row for row in s2r("show", store, "drives", "--json").json}
    for drive in read_drives(store / "drives"):
        row = rows[drive.name]
        expected = drive_errors(drive, drive.sim, NO_ALIGNMENT, DEFAULT_STEP)["ape_rmse_recorded"]
        assert row["ape_m"] == pytest.approx(expected, rel=1e-6)
        assert row["seconds"] == pytest.approx(3.0)
        assert row["travel_m"] == pytest.approx(3 * RADII[drive.name], rel=0.01)
    assert tuple(rows["wide"]) == NAMES


def test_playing_moves_in_time_and_ends_with_the_drive(store):
    session = Session(store, notebooks=ReadNotebook)
    session.dispatch(lambda _, state: replace(state, view="drives"))
    scene = load_scene(session, VIEW)
    before = VIEW.drawing(scene, 60).notes[0]
    assert before == "0.0 of 3.0 s"  # the simulator has not begun
    assert VIEW.play(session, scene, 3)
    assert session.state.moment == pytest.approx(3 * STEP)
    scene = load_scene(session, VIEW)
    assert "sim 0." in VIEW.drawing(scene, 60).notes[0]
    assert VIEW.play(session, scene, 1000)
    scene = load_scene(session, VIEW)
    assert session.state.moment == pytest.approx(3.0)
    assert not VIEW.play(session, scene, 1)
    VIEW.select_row(session, scene, 1)
    assert VIEW.chosen(load_scene(session, VIEW)).name == "wide"
    assert session.state.message == "the row wide stands for no instances"


def test_a_drive_that_cannot_be_read_does_not_hide_the_others(store, s2r):
    before = s2r("show", store, "drives", "--json").json
    (store / "drives/broken").mkdir()
    assert s2r("show", store, "drives", "--json").json == before
    notes = VIEW.drawing(load_scene(Session(store, notebooks=ReadNotebook), VIEW), 60).notes
    assert "broken: no real.* in it" in str(notes[1])


def test_a_store_without_drives_says_what_is_missing(tiny_store, s2r):
    shown = s2r("show", tiny_store, "drives", "--json")
    assert shown.json == []
    assert "no folder of drives" in shown.err
    words = s2r("show", tiny_store, "drives", "--words").printed
    assert "no folder of drives (drives/NAME/real.csv and sim.csv) in the store" in words
