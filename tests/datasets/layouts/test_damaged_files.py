"""Files with random damage are read with reports, or refused in one line, by every importer."""

import random
import shutil
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from s2rstore.errors import RequestError
from s2rtools.datasets.layouts import LAYOUTS
from s2rtools.datasets.scan import DecodedFrame
from tests.datasets.helpers import scan_of
from tests.datasets.layouts import test_colmap, test_lerobot, test_nerfstudio, test_polycam
from tests.datasets.layouts.bag_writer import walk_bag
from tests.datasets.layouts.checks import read_with
from tests.datasets.layouts.recordings import drive
from tests.datasets.layouts.rooms import walk, write_png
from tests.datasets.layouts.test_layouts_find_the_truth import NAMES, write
from tests.support import pairs

INSERTED = [
    b"nan", b"-inf", b"1e400", b"", b"\n", b" ", b",", b"-1", b"9" * 400, b"\xff", b"\0", b"[",
    b'"', b"../x", b"{", b":", b"#", b"1e308", b"1e-320",
]  # fmt: skip
ROUNDS = 30


def damaged(content: bytes, rng: random.Random) -> bytes:
    place = rng.randrange(len(content) + 1)
    kind = rng.randrange(5)
    if kind == 0:
        return content[:place] + rng.choice(INSERTED) + content[place + rng.choice([0, 1, 8]) :]
    if kind == 1:
        return content[:place] + content[place + rng.randrange(1, 40) :]
    if kind == 2:
        return content[:place]
    if kind == 3:
        return content[:place] + bytes([rng.randrange(256)]) + content[place + 1 :]
    lines = content.split(b"\n")
    rng.shuffle(lines)
    return b"\n".join(lines)


def colmap(folder: Path, is_binary: bool) -> Path:
    scene = walk(4)
    if is_binary:
        test_colmap.write_binary(folder / "sparse/0", scene, "PINHOLE")
    else:
        test_colmap.write_text(folder / "sparse/0", scene, {1: "PINHOLE"})
    for name, pixels in zip(test_colmap.names(scene), scene.rgb, strict=True):
        write_png(folder / "images" / name, pixels)
    return folder


def nerfstudio(folder: Path) -> Path:
    test_nerfstudio.write(folder, walk(4))
    return folder


def lerobot(folder: Path, version: str) -> Path:
    test_lerobot.write(folder, version, images=True)
    return folder


def polycam(folder: Path) -> Path:
    test_polycam.write(folder, drive(0.1 * k for k in range(4)))
    return folder


def video(folder: Path) -> Path:
    from tests.datasets.layouts import test_video  # skips where there is no av

    return test_video.write(folder)


def written(layout: str) -> Callable[[Path], Path]:
    return lambda folder: write(layout, folder / "side", drive(0.1 * k for k in range(4)))[0]


RECORDINGS: dict[str, tuple[Callable[[Path], Path], dict[str, str]]] = {
    **{layout: (written(layout), {}) for layout in NAMES},
    "colmap (binary)": (partial(colmap, is_binary=True), {}),
    "colmap (text)": (partial(colmap, is_binary=False), {}),
    "nerfstudio": (nerfstudio, {}),
    "polycam": (polycam, {}),
    "lerobot (v2.1)": (partial(lerobot, version="v2.1"), test_lerobot.OPTIONS),
    "lerobot (v3.0)": (partial(lerobot, version="v3.0"), test_lerobot.OPTIONS),
    "video": (video, {"start": "100"}),
    "bag (ROS 1)": (lambda folder: walk_bag(folder / "a.bag", walk(4)).write(), {}),
    "bag (SQLite)": (lambda folder: walk_bag(folder / "bag", walk(4)).write(), {}),
    "bag (MCAP)": (lambda folder: walk_bag(folder / "bag-mcap", walk(4)).write(), {}),
}
IMAGES = (".png", ".jpg")


def test_every_layout_is_damaged():
    assert {name.partition(" ")[0] for name in RECORDINGS} == set(LAYOUTS)


@pytest.mark.parametrize("name", RECORDINGS)
def test_damage_is_reported_or_refused(name, tmp_path):
    make, values = RECORDINGS[name]
    layout, path = name.partition(" ")[0], make(tmp_path)
    files = sorted(p for p in tmp_path.rglob("*") if p.is_file() and p.suffix not in IMAGES)
    outcomes = set()
    for number in range(ROUNDS // 2 if layout == "lerobot" else ROUNDS):
        rng = random.Random(number)
        file = rng.choice(files)
        content = file.read_bytes()
        file.write_bytes(damaged(content, rng))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            outcomes.add(outcome(layout, path, values))
        file.write_bytes(content)
    is_of_one_frame = layout in ("7scenes", "polycam")
    assert outcomes == ({"read"} if is_of_one_frame else {"read", "refused"})


def outcome(layout: str, path: Path, values: dict[str, str]) -> str:
    try:
        found = read_with(layout, path, **values)
    except RequestError as error:
        return "refused in several lines" if "\n" in str(error) else "refused"
    for trajectory in found.trajectories.values():
        count = len(trajectory.frames)
        assert count > 0
        assert trajectory.poses.shape == (count, 4, 4)
        assert trajectory.timestamps.shape == (count,)
        assert np.isfinite(trajectory.poses).all()
        for frame in trajectory.frames:
            frame.rgb.read()
    for issue in found.issues:
        assert issue.kind
        assert issue.file
        assert "\n" not in issue.kind + issue.file + issue.detail
    return "read"


def scanned(importer: str, path: Path, **options: object) -> str:
    """Whether a data set is refused, or all its frames are read or reported."""
    try:
        scan = scan_of(importer, path, **options)
    except RequestError as error:
        return "refused" if "\n" not in (text := str(error)) and len(text) < 500 else text
    issues = list(scan.issues)
    for records in scan.trajectories.values():
        for record in records:
            assert np.isfinite([record.x, record.y, record.heading]).all()
            for domain, source in record.sources.items():
                frame = source.decode(scan, scan.domains[domain])
                issues += frame.issues if isinstance(frame, DecodedFrame) else [frame]
    for issue in issues:
        assert issue.kind
        assert issue.file
        assert "\n" not in str(issue)
    return "reported" if issues else "read"


@pytest.mark.parametrize("rounds", [60, pytest.param(200, marks=pytest.mark.deep)])
@pytest.mark.parametrize("importer", ["csv", "sim2realviz"])
def test_damage_of_paired_images_is_reported_or_refused(importer, rounds, tmp_path):
    whole, folder = tmp_path / "whole", tmp_path / "data"
    options = {}
    if importer == "csv":
        path = folder / pairs.manifest(whole, n=4).name
    else:
        path, options = folder, {"header": folder / pairs.sim2realviz(whole, n=3).name}
    outcomes = set()
    for number in range(rounds):
        rng = random.Random(number)
        shutil.copytree(whole, folder)
        files = sorted(file for file in folder.rglob("*") if file.is_file())
        texts = [file for file in files if file.suffix in (".csv", ".toml")]
        file = rng.choice(rng.choice([texts, files]))
        if rng.randrange(8):
            file.write_bytes(damaged(file.read_bytes(), rng))
        else:
            file.unlink()
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            outcomes.add(scanned(importer, path, **options))
        shutil.rmtree(folder)
    assert outcomes == {"read", "reported", "refused"}
