"""What colours the instances on the map."""

import numpy as np

import s2rstore
from s2rstore.index.transaction import edit
from s2rtui.cli import scene_arguments
from s2rtui.session import map_values, view_settings
from s2rtui.session.session import Session
from tests.support.copies import copy_store


def test_the_command_line_and_the_session_know_the_same_values():
    assert tuple(map_values.MAP_VALUES) == scene_arguments.MAP_VALUES


def test_columns_are_those_of_the_language(tiny_store, s2r):
    names = [name for name in map_values.MAP_VALUES if name != "shift"]
    command = ["query", str(tiny_store), "all", "--run", "vanilla", "--format", "csv"]
    rows = s2r(*command, "--columns", ",".join(["iid", "shift", *names])).rows
    with s2rstore.open(tiny_store) as store:
        for name in ("shift", *names):
            values = map_values.column(store, "vanilla", name)
            expected = [float(row[name]) for row in rows]
            found = values[[int(row["iid"]) for row in rows]]
            assert np.allclose(found, expected, rtol=1e-3, atol=1e-4), name


def test_the_key_shows_every_value_and_begins_again(tiny_store):
    session = Session(tiny_store)
    seen = []
    for _ in map_values.MAP_VALUES:
        session.dispatch(view_settings.change_map_value)
        seen.append(session.state.map_value)
    assert sorted(seen) == sorted(map_values.MAP_VALUES)
    assert seen[-1] == "shift"


def test_without_shares_they_are_left_out_and_refused(tiny_store, tmp_path, s2r):
    path = copy_store(tiny_store, tmp_path / "s.s2r")
    with edit(path) as draft:
        draft.delete("zarr_array", kind="gap_shares")
    with s2rstore.open(path) as store:
        names = map_values.available(store, "vanilla")
        assert names == ("shift", "real.error", "sim.error", "gap")
        assert map_values.shown(store, "vanilla", "share.depth").name == "shift"
    figure = str(tmp_path / "m.png")
    command = ["export", str(path), "--view", "map", "--value", "share.depth", "--out", figure]
    s2r(*command).assert_refused("--value share.depth")
