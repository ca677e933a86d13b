"""`s2r ingest pairs --append`: further recordings in the worlds of a store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.layouts import LAYOUTS
from s2rtools.datasets.pairing.stored_worlds import stored_worlds
from s2rtools.datasets.recording import Layout, ReadOptions, Recording
from s2rtui.cli import main
from tests.support import recordings

N, MORE = 12, 16
TURN, SHIFT, UNITS = 0.7, np.array([5.0, -3.0]), 2.5
"""Where the sim world lies on the floor, and how many metres its unit is where it has a scale."""
Floats = np.ndarray


def scaled(path: Path, options: ReadOptions) -> Recording:
    """A recording whose layout leaves the scale of its world open."""
    recording = recordings.LAYOUT.read(path, options)
    for trajectory in recording.trajectories.values():
        trajectory.poses[:, :3, 3] /= UNITS
    recording.is_metric = False
    return recording


def pitched(path: Path, options: ReadOptions) -> Recording:
    """A recording whose camera looks 10 degrees downwards."""
    recording = recordings.LAYOUT.read(path, options)
    turn = Rotation.from_euler("x", -10, degrees=True).as_matrix()
    for trajectory in recording.trajectories.values():
        trajectory.poses[:, :3, :3] = trajectory.poses[:, :3, :3] @ turn
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
    tmp_path: Path, walks: dict[str, Floats], capsys: pytest.CaptureFixture[str]
) -> None:
    loose = {name: poses + np.array([0.03, -0.02, 0.01]) for name, poses in walks.items()}
    parts = [
        (write(tmp_path / f"sim-{name}", {name: loose[name]}, 1),
         write(tmp_path / f"real-{name}", {name: walks[name]}, 2))
        for name in walks
    ]  # fmt: skip
    whole = write(tmp_path / "sim", loose, 1), write(tmp_path / "real", walks, 2)
    grown, expected = tmp_path / "grown.s2r", tmp_path / "whole.s2r"
    floors = "--sim-floor", "ground=0", "--real-floor", "ground=0"
    assert ingest(*whole, expected, *floors) == 0
    assert ingest(*parts[0], grown, *floors) == 0
    with s2rstore.open(grown) as store:
        before, bounds = rows_of(grown, "first"), store.dataset.bounds
    capsys.readouterr()
    assert ingest(*parts[1], grown, *floors, "--append") == 0
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


def test_a_longer_recording_adds_its_further_pairs(
    tmp_path: Path, walks: dict[str, Floats]
) -> None:
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


@pytest.mark.parametrize("layout", ["test", "scaled"])
@pytest.mark.parametrize("match", ["name", "pose"])
def test_worlds_stay_aligned_as_they_are_stored(
    tmp_path: Path, walks: dict[str, Floats], layout: str, match: str
) -> None:
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
    floors = "--sim-floor", "ground=0", "--real-floor", "ground=0"
    assert (
        ingest(sims[0], reals[0], path, "--match", "name", "--align", *floors, layout=layout) == 0
    )
    again = ("--align",) if match == "name" else ()
    assert ingest(sims[1], reals[1], path, "--append", "--match", match, *again, layout=layout) == 0
    with s2rstore.open(path) as store:
        truth = np.concatenate([walks[name] + off[name] for name in walks])
        np.testing.assert_allclose(store.poses("sim")[:, :2], truth[:, :2], atol=1e-9)
        offsets = np.asarray(store.instances.pair_offset_m)
    np.testing.assert_allclose(offsets, [0.0] * N + [0.05] * MORE, atol=1e-9)


def test_recordings_of_another_world_or_camera_are_refused(
    tmp_path: Path, walks: dict[str, Floats], capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    path = tmp_path / "s.s2r"
    sims, reals = (
        [write(tmp_path / f"{k}-{name}", {name: poses}, k) for name, poses in walks.items()]
        for k in (1, 2)
    )
    more = sims[1], reals[1], path, "--append"
    assert ingest(*more) == 2
    assert "leave out --append to make it" in capsys.readouterr().err
    floors = "--sim-floor", "ground=0", "--real-floor", "ground=0"
    assert ingest(sims[0], reals[0], path, *floors) == 0
    assert ingest(sims[1], reals[1], path) == 2
    assert "or add recordings by --append" in capsys.readouterr().err
    assert ingest(*more, "--match", "name", "--align") == 2
    assert "the worlds of the store are not aligned" in capsys.readouterr().err
    with monkeypatch.context() as patch:
        patch.setattr(recordings, "HEIGHT", recordings.HEIGHT + 0.2)
        assert ingest(*more) == 2
    message = capsys.readouterr().err
    assert "0.800 m above the floor in the median, that of the store 0.600 m" in message
    with monkeypatch.context() as patch:
        patch.setitem(LAYOUTS, "test", Layout(pitched, "recordings of the tests"))
        assert ingest(*more) == 2
    assert "is -10.0 degrees in the median, of that of the store 0.0" in capsys.readouterr().err
    with s2rstore.open(path) as store:
        assert [part.instances for part in store.parts] == [N]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("world_to_floor", "[[1, 0], [0, 1]]", "4 x 4"),
        ("world_to_floor", str(np.diag([1.0, 2.0, 1.0, 1.0]).tolist()), "no rotation and scale"),
        ("world_to_floor", "{}", "recording:real"),
        ("metres_per_unit", "0", "no rotation and scale"),
    ],
)
def test_damaged_worlds_are_refused(
    tmp_path: Path, walks: dict[str, Floats], key: str, value: str, words: str
) -> None:
    path = tmp_path / "s.s2r"
    sim, real = (write(tmp_path / str(k), {"walk": walks["first"]}, k) for k in (1, 2))
    assert ingest(sim, real, path) == 0
    with edit(path) as draft:
        draft.set_provenance("recording:real", {key: value})
    with s2rstore.open(path) as store, pytest.raises(RequestError, match=words):
        stored_worlds(store)


def test_a_store_of_another_origin_is_refused(tiny_store: Path) -> None:
    with s2rstore.open(tiny_store) as store, pytest.raises(RequestError, match="ingest pairs"):
        stored_worlds(store)
