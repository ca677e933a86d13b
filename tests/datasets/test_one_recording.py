"""`s2r ingest LAYOUT:PATH --side`: a recording whose instances have images of one side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.geometry import angles
from s2rstore.language import evaluation
from s2rstore.maintenance.verify import verify
from s2rstore.records import NO_RUN
from s2rtools.datasets.layouts import LAYOUTS
from s2rtui.cli import main
from tests.support import recordings

N, MORE = 12, 16
PAIRS = recordings.walk(N)
ALONE = recordings.walk(MORE, seed=5, step=0.7)


@pytest.fixture(autouse=True)
def known_layout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(LAYOUTS, "test", recordings.LAYOUT)


def write(folder: Path, poses: np.ndarray, name: str, seed: int) -> Path:
    return recordings.write(folder, recordings.side(poses, name=name), seed=seed)


def ingest(store: Path, *arguments: str) -> int:
    return main(["ingest", *arguments, "--store", str(store), "--size", "16"])


def selected(store: Path, *expressions: str) -> list[int]:
    with s2rstore.open(store) as opened:
        return [int(evaluation.select(opened, text, NO_RUN).sum()) for text in expressions]


def test_a_recording_makes_a_store_to_which_the_other_side_is_appended(tmp_path, capsys):
    store = tmp_path / "s.s2r"
    real = write(tmp_path / "real", PAIRS, "walk", 1)
    sim = write(tmp_path / "sim", ALONE, "render", 2)
    more = write(tmp_path / "more", recordings.walk(MORE, seed=6, step=0.7), "further", 3)
    assert ingest(store, f"test:{real}", "--side", "real", "--floor", "ground=0") == 0
    assert f"{N} instances in real; trajectories walk ({N})" in capsys.readouterr().out
    assert ingest(store, f"test:{sim}", "--side", "sim", "--floor", "ground=0", "--append") == 0
    assert ingest(store, f"test:{more}", "--side", "sim", "--append") == 0
    assert verify(store) == []
    assert selected(store, "has:real", "has:sim", "paired", "all") == [
        N, 2 * MORE, 0, N + 2 * MORE,
    ]  # fmt: skip
    with s2rstore.open(store) as opened:
        iids = opened.iids_of("render")
        np.testing.assert_allclose(opened.poses("sim")[iids, :2], ALONE[:, :2], atol=1e-9)
        turned = angles.distance(opened.poses("sim")[iids, 2], ALONE[:, 2])
        assert turned.max() < 1e-9
        assert opened.frame("sim", int(iids[3])).rgb.any()


def test_what_pairs_left_out_is_appended_from_the_same_recordings(tmp_path):
    """Each side has a trajectory of its own; the sim poses of pairs are off by 5 cm."""
    store, folders = tmp_path / "s.s2r", []
    for offset, name in ((0.05, "renders"), (0, "photos")):
        walk, own = (
            recordings.side(PAIRS + np.array([offset, 0, 0])),
            recordings.side(ALONE, name=name),
        )
        both = recordings.Side(
            walk.poses | own.poses, walk.names | own.names, walk.times | own.times
        )
        folders.append(recordings.write(tmp_path / name, both, seed=len(name)))
    options = [word for side, folder in zip(("sim", "real"), folders, strict=True)
               for word in (f"--{side}", f"test:{folder}", f"--{side}-floor", "ground=0",
                            f"--{side}-trajectory", "walk")]  # fmt: skip
    assert ingest(store, "pairs", *options, "--match", "name") == 0
    for side, folder in zip(("sim", "real"), folders, strict=True):
        assert ingest(store, f"test:{folder}", "--side", side, "--append") == 0
    assert verify(store) == []
    assert selected(store, "paired", "traj:renders & has:sim", "traj:photos & has:real", "all") == [
        N, MORE, MORE, N + 2 * MORE,
    ]  # fmt: skip
    with s2rstore.open(store) as opened:
        poses = opened.poses("sim")[opened.iids_of("renders"), :2]
    np.testing.assert_allclose(poses, ALONE[:, :2], atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("nowhere:x", "--side", "sim"), "layout 'nowhere': one of"),
        (("test:", "--side", "sim"), "test:: give LAYOUT:PATH"),
        (("test:x", "--side", "sim", "--append"), "no such store to append to"),
    ],
)
def test_what_cannot_be_ingested_is_refused(tmp_path, capsys, arguments, words):
    assert ingest(tmp_path / "s.s2r", *arguments) == 2
    assert words in capsys.readouterr().err
    with pytest.raises(SystemExit):
        ingest(tmp_path / "s.s2r", "test:x")
    assert "--side" in capsys.readouterr().err
