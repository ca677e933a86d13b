"""`s2r render` adds sim-only instances to a store, and sim images to its real-only instances."""

import shlex

import numpy as np
import pytest

import s2rstore
from s2rstore.geometry import angles
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.layouts import LAYOUTS, read
from tests.support import recordings
from tests.support.perl_renderer import depth_of, perl_command, rgb_of


@pytest.fixture
def render(s2r):
    def run(store, *arguments, mode="npy"):
        command = shlex.join([*perl_command(), mode])
        return s2r("render", store, "--renderer", command, *arguments)

    return run


def _assert_frames(store, iids):
    """Frames of the store are those that the Perl renderer wrote."""
    domain, height = store.domain("sim"), store.dataset.frame_height
    for iid in iids:
        frame = store.frame("sim", int(iid))
        np.testing.assert_array_equal(frame.rgb, rgb_of(height, store.dataset.frame_width))
        metres = depth_of(height, store.dataset.frame_width, store.instances.x[iid])
        raw = np.rint(metres / domain.depth_scale)
        raw[raw > domain.depth_raw_max] = 0
        np.testing.assert_allclose(frame.depth, raw, atol=1)


def _runs(s2r, path):
    """The figures of the runs of a store."""
    rows = s2r("runs", path, "--json").json
    return [{name: value for name, value in row.items() if name != "note"} for row in rows]


def test_sim_only_instances_are_added(render, s2r, store_copy):
    before = _runs(s2r, store_copy)
    with s2rstore.open(store_copy) as store:
        count = len(store.instances)
    assert "5 instances added" in render(store_copy, "--random", "5", "--seed", "3").printed
    assert verify(store_copy) == []
    with s2rstore.open(store_copy) as store:
        iids = store.iids_of("random-3")
        assert len(iids) == 5
        assert len(store.instances) == count + 5
        assert not store.imaged("real")[iids].any()
        _assert_frames(store, iids)
    assert s2r("query", store_copy, "paired", "--count").printed.split()[0] == str(count)
    assert _runs(s2r, store_copy) == before
    more = render(store_copy, "--random", "8", "--seed", "3").printed
    assert "3 frames rendered by perl 3, 5 there before" in more
    assert "3 instances added" in more
    again = render(store_copy, "--random", "8", "--seed", "3").printed
    assert "0 frames rendered by perl 3, 8 there before" in again


@pytest.fixture
def ingest_real(s2r, tmp_path, monkeypatch):
    """Ingest or append the first images of a real walk; returns the path of the store."""
    monkeypatch.setitem(LAYOUTS, "test", recordings.LAYOUT)
    path, poses = tmp_path / "real.s2r", recordings.walk(9, seed=4)

    def ingest(count):
        side = recordings.side(poses, np.arange(count))
        real = recordings.write(tmp_path / f"real{count}", side, seed=1)
        options = ("--append",) if path.exists() else ("--floor", "ground=0", "--size", "16")
        s2r("ingest", f"test:{real}", "--side", "real", "--store", path, *options).checked()
        return path

    return ingest


def test_real_instances_get_sim_images(render, ingest_real):
    real_store = ingest_real(6)
    failed = render(real_store, "--missing", mode="fails-at-1").checked(1)
    assert "1 frame failed; the first: pose 2: inside a wall" in failed.err
    assert "unchanged; images are added when all instances have one" in failed.err
    printed = render(real_store, "--missing").printed
    assert "1 frame rendered by perl 3, 5 there before" in printed
    assert "sim added" in printed
    assert verify(real_store) == []
    with s2rstore.open(real_store) as store:
        assert store.imaged("sim", "real").all()
        assert len(store.instances) == 6
        _assert_frames(store, range(6))
        difference = store.poses("sim") - store.poses("real")
        assert np.abs(difference[:, :2]).max() < 1e-9
        assert angles.distance(difference[:, 2], 0).max() < 1e-9
    assert "has images of all instances" in render(real_store, "--missing").checked(2).err


def test_the_further_part_of_a_real_trajectory_gets_sim_images(render, ingest_real):
    for count in (6, 9):
        path = ingest_real(count)
        printed = render(path, "--missing").printed
    assert "3 frames rendered by perl 3, 6 there before" in printed
    assert verify(path) == []
    with s2rstore.open(path) as store:
        assert store.imaged("sim", "real").all()
        _assert_frames(store, range(9))


def test_cameras_ahead_of_the_pose_and_of_their_own_for_depth(render, store_copy, tmp_path):
    poses = tmp_path / "walk.csv"
    poses.write_text("x_m,y_m,heading_deg\n2,3,90\n4,5,0\n")
    with edit(store_copy) as draft:
        draft.update("domain", {"domain": "sim"}, {"forward_offset": 0.5, "depth_fx": 7.0})
    render(store_copy, "--poses", poses, "--trajectory", "ahead").checked()
    assert verify(store_copy) == []
    with s2rstore.open(store_copy) as store:
        iids = store.iids_of("ahead")
        expected = [[2, 3, np.pi / 2], [4, 5, 0]]
        np.testing.assert_allclose(store.poses("sim")[iids], expected, atol=1e-9)
        _assert_frames(store, iids)
    recording = read("csv", tmp_path / "own-frames" / "frames.csv")
    assert recording.depth_camera.fx == 7.0
    cameras = recording.trajectories["ahead"].poses[:, :2, 3]  # y of the map grows downwards
    np.testing.assert_allclose(cameras, [[2, -3.5], [4.5, -5]], atol=1e-9)
