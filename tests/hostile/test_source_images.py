"""`s2r verify --source`: the ingested images are compared with the checksums of the index."""

import shutil
from pathlib import Path

import cv2
import pytest

from s2rstore.index.transaction import edit
from s2rtools.datasets.layouts import LAYOUTS
from s2rtui.cli import main
from tests.support import recordings
from tests.support.copies import copy_store
from tests.support.ingested import build_ingested_store


@pytest.fixture(scope="module")
def ingested(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a data set and the store that was made from it."""
    folder = tmp_path_factory.mktemp("ingested")
    build_ingested_store(folder / "s.s2r", n=3)
    return folder


@pytest.fixture
def folder(ingested: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(ingested, tmp_path / "own"))


@pytest.mark.parametrize("image", ["rgb", "depth"])
def test_every_changed_byte_of_a_jpeg_is_found(folder, image, s2r):
    path = sorted((folder / "s-data" / "traj1" / "real").glob(f"*_{image}.jpeg"))[1]
    content = bytearray(path.read_bytes())
    decoded = False
    for place in range(len(content) // 2, len(content), len(content) // 4):
        changed = content.copy()
        changed[place] ^= 1
        path.write_bytes(changed)
        decoded |= cv2.imread(str(path)) is not None
        result = s2r("verify", folder / "s.s2r", "--source", folder / "s-data").checked(1)
        (line,) = [each for each in result.out.splitlines() if path.name in each]
        assert "source file is not the ingested one" in line
    assert decoded


def test_a_missing_image_and_another_folder_are_told(folder, tmp_path, s2r):
    store, data = str(folder / "s.s2r"), folder / "s-data"
    path = min((data / "traj1" / "sim").glob("*_depth.jpeg"))
    path.unlink()
    assert main(["verify", store, "--source", f"real={data}"]) == 0
    missing = s2r("verify", store, "--source", f"sim={data}").checked(1).out
    assert f"source file missing: {path}" in missing
    for source, reason in (
        (str(tmp_path), "has no image of domain"),
        (str(tmp_path / "none"), "no such folder"),
        (f"other={data}", "other"),
    ):
        s2r("verify", store, "--source", source).assert_refused(reason)


def test_no_file_outside_the_folder_is_read(folder, s2r):
    store = copy_store(folder / "s.s2r", folder / "other.s2r")
    with edit(store) as draft:
        draft.update("frame", {"iid": 0, "domain": "sim"}, {"rgb_path": "../secret.jpeg"})
        draft.update("frame", {"iid": 1, "domain": "sim"}, {"rgb_path": "/dev/zero"})
    printed = s2r("verify", store, "--source", folder / "s-data").checked(1).out
    assert printed.count("; it is not read") == 2


def test_images_of_recordings_are_compared(tmp_path, monkeypatch, s2r):
    monkeypatch.setitem(LAYOUTS, "test", recordings.LAYOUT)
    side = recordings.side(recordings.walk(4))
    sim, real = (recordings.write(tmp_path / n, side, seed=i) for i, n in enumerate("sr"))
    store = str(tmp_path / "s.s2r")
    words = ["--sim", f"test:{sim}", "--real", f"test:{real}", "--size", "16", "--store", store]
    assert (
        main(["ingest", "pairs", *words, "--sim-floor", "ground=0", "--real-floor", "ground=0"])
        == 0
    )
    words = ["verify", store, "--source", f"sim={sim}", "--source", f"real={real}"]
    assert main(words) == 0
    path = real / "walk" / "depth" / "image-0002.png"
    path.write_bytes(path.read_bytes() + b"x")
    (line,) = (each for each in s2r(*words).checked(1).out.splitlines() if "walk" in each)
    assert "real: walk/image-0002.png" in line
