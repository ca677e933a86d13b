"""`s2r ingest pairs --append`: further recordings in the worlds of a store."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.maintenance.verify import verify
from s2rstore.reader import Store
from s2rtools.datasets.layouts import LAYOUTS
from s2rtools.datasets.pairing.stored_worlds import stored_worlds
from s2rtools.datasets.recording import Layout, ReadOptions, Recording
from s2rtui.cli import main
from tests.support import recordings

N, MORE = 12, 16
TURN, SHIFT, UNITS = 0.7, np.array([5.0, -3.0]), 2.5
"""Where the sim world lies on the floor, and how many metres its unit is where it has a scale."""
FLOORS = "--sim-floor", "ground=0", "--real-floor", "ground=0"
Floats = np.ndarray
MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0]).tolist()


def scaled(path: Path, options: ReadOptions) -> Recording:
    """A recording whose layout leaves the scale of its world open."""
    recording = recordings.LAYOUT.read(path, options)
    for trajectory in recording.trajectories.values():
        trajectory.poses[:, :3, 3] /= UNITS
    recording.is_metric = False
    return recording


def rotated(axis: str, degrees: float, path: Path, options: ReadOptions) -> Recording:
    """A recording whose world is rotated."""
    recording = recordings.LAYOUT.read(path, options)
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    for trajectory in recording.trajectories.values():
        trajectory.poses[:] = turn @ trajectory.poses
    return recording


@pytest.fixture(autouse=True)
def known_layouts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LAYOUTS, "test", recordings.LAYOUT)
    monkeypatch.setitem(LAYOUTS, "scaled", Layout(scaled, "recordings of the tests"))


@pytest.fixture
def walks() -> dict[str, Floats]:
    """Poses of two trajectories."""
    return {"first": recordings.walk(N), "second": recordings.walk(MORE, seed=5, step=0.7)}


def turned(poses: Floats) -> Floats:
    """Poses of the floor in a sim world that is turned and moved."""
    cos, sin = np.cos(TURN), np.sin(TURN)
    places = poses[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + SHIFT
    return np.column_stack([places, poses[:, 2] + TURN])


def write(folder: Path, walks: Mapping[str, Floats], seed: int, start: float = 0.0) -> Path:
    """A recording with the images and times of each walk."""
    sides = [recordings.side(poses, name=name) for name, poses in walks.items()]
    poses, names = {}, {}
    for side in sides:
        poses |= side.poses
        names |= side.names
    times = {n: [start + 100.0 * k + t for t in s.times[n]]
             for k, (n, s) in enumerate(zip(walks, sides, strict=True))}  # fmt: skip
    side = replace(sides[0], poses=poses, names=names, times=times)
    return recordings.write(folder, side, seed=seed)


def both_sides(folder: Path, walks: Mapping[str, Floats]) -> tuple[list[Path], list[Path]]:
    """A sim and a real recording of each walk, with equal poses."""
    sims, reals = (
        [write(folder / f"{k}-{name}", {name: poses}, k) for name, poses in walks.items()]
        for k in (1, 2)
    )
    return sims, reals


def ingest(sim: Path, real: Path, store: Path, *more: str, layout: str = "test") -> int:
    return main(
        ["ingest", "pairs", "--sim", f"{layout}:{sim}", "--real", f"test:{real}", "--size", "16",
         "--store", str(store), *more]
    )  # fmt: skip


def rows_of(path: Path, trajectory: str) -> list[tuple]:
    """Poses, offsets and poses of frames of a trajectory, in recording order."""
    query = """
        SELECT i.x, i.y, i.heading, pair_offset_m, pair_offset_deg, f.* EXCLUDE (iid, domain)
        FROM instance i JOIN frame_pose f USING (iid) WHERE trajectory = ? ORDER BY seq, f.domain
    """
    with s2rstore.open(path) as store:
        return store.execute(query, [trajectory])


def test_a_further_trajectory_is_stored_as_if_it_were_ingested_with_the_first(
    tmp_path, walks, capsys
):
    loose = {name: poses + np.array([0.03, -0.02, 0.01]) for name, poses in walks.items()}
    parts = [
        (write(tmp_path / f"sim-{name}", {name: loose[name]}, 1),
         write(tmp_path / f"real-{name}", {name: walks[name]}, 2))
        for name in walks
    ]  # fmt: skip
    whole = write(tmp_path / "sim", loose, 1), write(tmp_path / "real", walks, 2)
    grown, expected = tmp_path / "grown.s2r", tmp_path / "whole.s2r"
    assert ingest(*whole, expected, *FLOORS) == 0
    assert ingest(*parts[0], grown, *FLOORS) == 0
    with s2rstore.open(grown) as store:
        before, bounds = rows_of(grown, "first"), store.dataset.bounds
    capsys.readouterr()
    assert ingest(*parts[1], grown, *FLOORS, "--append") == 0
    output = capsys.readouterr().out
    assert "--real-floor is not used: the floor is that of the store" in output
    assert f"{MORE} instances added, now {N + MORE}; trajectories second ({MORE})" in output
    assert rows_of(grown, "first") == before
    np.testing.assert_allclose(rows_of(grown, "second"), rows_of(expected, "second"), atol=1e-12)
    with s2rstore.open(grown) as store:
        assert len(store.parts) == 2
        assert store.dataset.bounds == bounds
        assert store.provenance("pairs:1")["pairs"] == str(MORE)
        assert store.provenance("pairs")["pairs"] == str(N)
        assert store.provenance("recording:real:1")["layout"] == "test"
    assert verify(grown) == []
    assert ingest(*parts[1], grown, "--append") == 0
    with s2rstore.open(grown) as store:
        assert len(store.instances) == N + MORE


def test_a_longer_recording_adds_its_further_pairs(tmp_path, walks):
    path, poses = tmp_path / "s.s2r", walks["second"]
    short = [write(tmp_path / f"{k}-short", {"walk": poses[:N]}, k) for k in (1, 2)]
    long = [write(tmp_path / f"{k}-long", {"walk": poses}, k) for k in (1, 2)]
    assert ingest(*short, path) == 0
    before = rows_of(path, "walk")
    for each, other in zip(short, long, strict=True):  # as a recording that went on
        for file in each.rglob("*.png"):
            (other / file.relative_to(each)).write_bytes(file.read_bytes())
    assert ingest(*long, path, "--append") == 0
    assert rows_of(path, "walk")[: len(before)] == before
    with s2rstore.open(path) as store:
        np.testing.assert_allclose(store.poses("sim")[:, :2], poses[:, :2], atol=1e-9)
    assert verify(path) == []


def test_other_sim_poses_of_stored_images_are_refused(tmp_path, walks, capsys):
    path, poses = tmp_path / "s.s2r", walks["first"]
    moved = poses.copy()
    moved[3, 0] += 0.02
    real = write(tmp_path / "real", {"walk": poses}, 2)
    sims = [
        write(tmp_path / f"sim-{k}", {"walk": each}, 1) for k, each in enumerate((poses, moved))
    ]
    assert ingest(sims[0], real, path, *FLOORS) == 0
    assert ingest(sims[1], real, path, "--append") == 2
    assert "(the pose of walk/image-0003.png" in capsys.readouterr().err


@pytest.mark.parametrize(("layout", "match"), [("test", "name"), ("scaled", "pose")])
def test_worlds_stay_aligned_as_they_are_stored(tmp_path, walks, layout, match, capsys):
    """The further pairs alone would be aligned otherwise: their sim poses are off by 5 cm."""
    path = tmp_path / "s.s2r"
    off = {"first": np.zeros(3), "second": np.array([0.05, 0.0, 0.0])}
    sims, reals = (
        [write(tmp_path / f"{side}-{name}", {name: place(name)}, seed) for name in walks]
        for side, seed, place in (
            ("sim", 1, lambda name: turned(walks[name] + off[name])),
            ("real", 2, lambda name: walks[name]),
        )
    )
    assert (
        ingest(sims[0], reals[0], path, "--match", "name", "--align", *FLOORS, layout=layout) == 0
    )
    again = ("--align",) if match == "name" else ()
    assert ingest(sims[1], reals[1], path, "--append", "--match", match, *again, layout=layout) == 0
    output = capsys.readouterr()
    assert "sim floor as in the store, turned by" in output.out
    assert "far apart" not in output.err
    other = write(tmp_path / "other", {"third": walks["first"]}, 3)
    third = write(tmp_path / "real-third", {"third": walks["first"]}, 4)
    assert ingest(other, third, path, "--append", "--match", "name", "--strict", layout=layout) == 2
    assert "poses of pairs far apart" in capsys.readouterr().err
    with s2rstore.open(path) as store:
        truth = np.concatenate([walks[name] + off[name] for name in walks])
        np.testing.assert_allclose(store.poses("sim")[:, :2], truth[:, :2], atol=1e-9)
        offsets = np.asarray(store.instances.pair_offset_m)
    np.testing.assert_allclose(offsets, [0.0] * N + [0.05] * MORE, atol=1e-9)


def test_recordings_of_another_world_or_camera_are_refused(tmp_path, walks, capsys, monkeypatch):
    path = tmp_path / "s.s2r"
    sims, reals = both_sides(tmp_path, walks)
    more = sims[1], reals[1], path, "--append"
    assert ingest(*more) == 2
    assert "leave out --append to make it" in capsys.readouterr().err
    assert ingest(sims[0], reals[0], path, *FLOORS) == 0
    assert ingest(sims[1], reals[1], path) == 2
    assert "or add recordings by --append" in capsys.readouterr().err
    assert ingest(*more, "--match", "name", "--align") == 2
    assert "the worlds of the store are not aligned" in capsys.readouterr().err
    with monkeypatch.context() as patch:
        patch.setattr(recordings, "HEIGHT", recordings.HEIGHT + 0.2)
        assert ingest(*more) == 2
    message = capsys.readouterr().err
    assert "camera 0.800 m above it (0.000 m between" in message
    assert "the stored camera: 0.600 m (0.000 m), pitch 0.00 degrees" in message
    for axis, angle in (("x", 10), ("x", -90), ("z", 180)):
        with monkeypatch.context() as patch:
            layout = Layout(partial(rotated, axis, angle), "recordings of the tests")
            patch.setitem(LAYOUTS, "test", layout)
            assert ingest(*more) == (0 if axis == "z" else 2)
        message = capsys.readouterr().err
        assert ("append what is recorded in the world of the store" in message) == (axis != "z")
    with s2rstore.open(path) as store:
        assert [part.instances for part in store.parts] == [N, MORE]


@pytest.fixture(scope="module")
def aligned(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Store]:
    """A store of two recordings whose worlds are aligned."""
    folder = tmp_path_factory.mktemp("aligned")
    sim, real = (write(folder / str(k), {"walk": recordings.walk(N)}, k) for k in (1, 2))
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(LAYOUTS, "test", recordings.LAYOUT)
        assert ingest(sim, real, folder / "s.s2r", "--match", "name", "--align") == 0
    with s2rstore.open(folder / "s.s2r") as store:
        stored_worlds(store)
        yield store


@pytest.mark.parametrize(
    ("section", "key", "value", "words"),
    [
        ("recording:real", "world_to_floor", "[[1, 0], [0, 1]]", "no rotation"),
        ("recording:real", "world_to_floor", "{}", "recording:real"),
        ("recording:real", "world_to_floor", str(MIRROR), "no rotation"),
        ("recording:real", "metres_per_unit", "0", "no rotation and scale"),
        ("recording:real", "tilt_median", "[]", "tilt_median"),
        ("recording:real", "height_spread", "1e300", "implausible"),
        ("pairs", "alignment", {"scale": 0.0}, "pairs: alignment"),
        ("pairs", "alignment", {"x": 1e308}, "pairs: alignment"),
        ("pairs", "alignment", {"angle": "a"}, "pairs: alignment"),
    ],
)
def test_damaged_worlds_are_refused(aligned, monkeypatch, section, key, value, words):
    """The store answers as if its index had this value."""
    if isinstance(value, dict):
        value = json.dumps(aligned.provenance_object(section, key) | value)
    facts = aligned.provenance
    changed = facts(section) | {key: value}
    monkeypatch.setattr(
        aligned, "provenance", lambda name: changed if name == section else facts(name)
    )
    with pytest.raises(RequestError, match=words):
        stored_worlds(aligned)


def test_a_trajectory_in_a_world_of_its_own_is_continued_but_not_added(
    tmp_path, walks, capsys, monkeypatch
):
    def odometry(path: Path, options: ReadOptions) -> Recording:
        recording = recordings.LAYOUT.read(path, options)
        recording.has_own_worlds = True
        return recording

    monkeypatch.setitem(LAYOUTS, "test", Layout(odometry, "recordings of the tests"))
    path = tmp_path / "s.s2r"
    sims, reals = both_sides(tmp_path, walks)
    assert ingest(sims[0], reals[0], path) == 0
    assert ingest(sims[0], reals[0], path, "--append") == 0
    monkeypatch.setitem(LAYOUTS, "test", recordings.LAYOUT)  # the store knows it
    capsys.readouterr()
    assert ingest(sims[1], reals[1], path, "--append") == 2
    assert "trajectory second has no known place in the store" in capsys.readouterr().err


def test_depth_is_not_added_to_a_domain_without(tmp_path, walks, capsys):
    path, walk = tmp_path / "s.s2r", recordings.side(walks["first"])
    flat = [recordings.write(tmp_path / str(k), walk, has_depth=False, seed=k) for k in (1, 2)]
    deep = [write(tmp_path / f"deep-{k}", {"second": walks["second"]}, k) for k in (1, 2)]
    assert ingest(*flat, path) == 0
    assert ingest(*deep, path, "--append") == 2
    assert "has depth, domain sim of the store has none" in capsys.readouterr().err


def test_a_store_of_another_origin_is_refused(tiny_store):
    with s2rstore.open(tiny_store) as store, pytest.raises(RequestError, match="ingest pairs"):
        stored_worlds(store)
