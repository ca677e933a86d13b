"""Invalid input is reported and skipped, and rejected with --strict."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.dataset_config import (
    BoundsTable,
    DatasetConfig,
    DatasetTable,
    DomainTable,
    FieldOfViewCamera,
    IntrinsicsCamera,
    RoomTable,
)
from s2rtools.datasets.files.path_containment import PathContainment
from tests.datasets.helpers import ingest, kinds
from tests.support import pairs


def _first(root: Path, domain: str, image: str) -> Path:
    return sorted((root / "traj1" / domain).glob(f"*_{image}.jpeg"))[0]


def _truncate(root: Path) -> None:
    path = _first(root, "real", "rgb")
    path.write_bytes(path.read_bytes()[:-200])


def _garbage(root: Path) -> None:
    _first(root, "sim", "depth").write_bytes(b"not a picture")


def _empty(root: Path) -> None:
    _first(root, "sim", "rgb").write_bytes(b"")


def _wrong_size(root: Path) -> None:
    cv2.imwrite(str(_first(root, "real", "depth")), np.zeros((20, 30), np.uint8))


def _colour_depth(root: Path) -> None:
    shutil.copy(_first(root, "real", "rgb"), _first(root, "real", "depth"))


def _grey_photo(root: Path) -> None:
    grey = cv2.imread(str(_first(root, "real", "rgb")), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(_first(root, "real", "depth")), grey)


def _paired_twice(root: Path) -> None:
    path = root / "traj1" / "sim" / "match.csv"
    rows = path.read_text().splitlines()
    real, sim = rows[1].split(",")[0], rows[3].split(",")[1]
    path.write_text("\n".join([*rows, f"{real},{sim}"]) + "\n")


def _stray_depth(root: Path) -> None:
    path = _first(root, "real", "depth")
    shutil.copy(path, path.with_name("x9.000_y9.000_z0.000_r9_depth.jpeg"))


def _outside(root: Path) -> None:
    header = root / "calibration.toml"
    header.write_text(header.read_text().replace("x1 = 8.0", "x1 = 6.9"))


def _broken_plan(root: Path) -> None:
    (root / "map.jpg").write_bytes(b"not a picture")


def _half_size(root: Path) -> None:
    for path in (root / "traj1").rglob("*.jpeg"):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), cv2.resize(image, (32, 24)))


def _missing(root: Path) -> None:
    _first(root, "real", "depth").unlink()


def _bad_row(root: Path) -> None:
    with (root / "traj1" / "sim" / "match.csv").open("a") as file:
        file.write("what.jpeg,ever.jpeg\n")


def _nan_pose(root: Path) -> None:
    path = root / "traj1" / "sim" / "match.csv"
    rows = path.read_text().splitlines()
    real, sim = rows[1].split(",")
    for image in ("rgb", "depth"):
        old = root / "traj1" / "sim" / sim.replace("_rgb", f"_{image}")
        old.rename(old.with_name(f"xnan_y0.047_z1.0_r4_{image}.jpeg"))
    rows[1] = f"{real},xnan_y0.047_z1.0_r4_rgb.jpeg"
    path.write_text("\r\n".join(rows) + "\r\n")


def _duplicate(root: Path) -> None:
    path = root / "traj1" / "sim" / "match.csv"
    path.write_text(path.read_text() + path.read_text().splitlines()[1] + "\n")


@pytest.mark.parametrize(
    ("damage", "kind", "remaining"),
    [
        (_truncate, "truncated image", 7),
        (_garbage, "unreadable image", 7),
        (_empty, "unreadable image", 7),
        (_wrong_size, "wrong size", 7),
        (_colour_depth, "not a depth image", 7),
        (_missing, "missing image", 7),
        (_grey_photo, "not a depth image", 7),
        (_paired_twice, "duplicate row", 8),
        (_stray_depth, "unmatched image", 8),
        (_outside, "pose outside the bounds", 8),
        (_broken_plan, "unreadable floor plan", 8),
        (_half_size, "other size than calibrated", 8),
        (_bad_row, "bad name", 8),
        (_nan_pose, "bad pose", 7),
        (_duplicate, "duplicate row", 8),
    ],
)
def test_invalid_input_is_reported_and_skipped_or_rejected_if_strict(
    data, tmp_path: Path, damage, kind: str, remaining: int
) -> None:
    damage(data[0])
    with pytest.raises(RequestError, match="nothing was ingested"):
        ingest("sim2realviz", data[0], tmp_path / "strict.s2r", strict=True, header=data[1])
    assert not list(tmp_path.glob("*strict.s2r*"))
    scan = ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])
    assert kind in kinds(scan)
    assert all(issue.file for issue in scan.issues)
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == remaining
        assert store.instances.seq.tolist() == list(range(remaining))
    assert verify(tmp_path / "s.s2r") == []


def test_images_without_a_row_are_reported(data, tmp_path: Path) -> None:
    extra = _first(data[0], "real", "rgb")
    shutil.copy(extra, extra.with_name("x9.000_y9.000_z0.000_r9_rgb.jpeg"))
    scan = ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])
    assert kinds(scan) == {"unmatched image": 1}


@pytest.mark.parametrize("content", ["nothing", "empty", "no images"])
def test_empty_folders_are_rejected(tmp_path: Path, content: str) -> None:
    root = tmp_path / "data"
    if content != "nothing":
        for domain in ("sim", "real"):
            (root / "traj1" / domain).mkdir(parents=True)
    if content == "no images":
        (root / "traj1" / "sim" / "match.csv").write_text("REAL_RGB,SIM_RGB\n")
    with pytest.raises(RequestError):
        ingest("sim2realviz", root, tmp_path / "s.s2r")
    assert not (tmp_path / "s.s2r").exists()


def _edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "kind"),
    [
        ("a,0,real", "a,zero,real", "bad seq"),
        ("a,0,real", "a,0,sim", "duplicate row"),
        ("a,0,real", ",0,real", "incomplete row"),
        ("a,0,real,", "a,0,real,,", "incomplete row"),
        ("sim/1_rgb.png", "sim/no_rgb.png", "missing image"),
        (",7.0,", ",nan,", "bad pose"),
    ],
)
def test_problems_of_a_manifest_are_reported(tmp_path: Path, old: str, new: str, kind: str) -> None:
    path = pairs.manifest(tmp_path / "data")
    _edit(path, old, new)
    scan = ingest("csv", path, tmp_path / "s.s2r")
    assert kind in kinds(scan)
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == 11


@pytest.mark.parametrize(
    ("old", "new", "hint"),
    [
        ('kind = "real"', 'kind = "other"', 'kind = "sim" or "real"'),
        ("x1 = 8.0", "x1 = -8.0", "larger"),
        ("hfov = 80.0", "hfov = true", "sim.rgb.hfov: expected a number, got true"),
        ("[bounds]", "[bounds", "data.toml"),
        ("[domains.real]", "[domains.elsewhere]", "domains.real"),
        ("width = 64", "width = 0", "rgb.width: expected a number > 0, got 0"),
        ("y_down", "y_donw", "data.toml: y_donw: unknown key; did you mean y_down?"),
        ("x1 = 8.0", "x1 = 8.0\nxx1 = 1.0", "data.toml: bounds.xx1: unknown key; did you mean x1"),
        ("[[rooms]]", "[[rooms]]\nnmae = 1", r"rooms\[0\].nmae: unknown key; known: room, rect"),
        ("camera_height", "camera_hight", "sim.camera_hight: unknown key; did you mean camera_h"),
        ("hfov = 80.0", "hfov = 80.0, pich = 2", "sim.rgb.pich: unknown key; did you mean pitch"),
        ("hfov = 80.0", "hfov = 80.0, fx = 20", "sim.rgb.fx: unknown key"),
        ("hfov = 80.0", "hfov = 180.0", "hfov: expected a number <= 179, got 180"),
        ("hfov = 80.0", "fx = 10", "sim.rgb.fy: missing"),
        ("depth = { hfov = 80.0 }", "depth = 3", "sim.depth: expected a table, got 3"),
        ("depth_raw_min = 6", 'depth_raw_min = "6"', 'depth_raw_min: expected a number, got "6"'),
        ("depth_raw_min = 6", "depth_raw_min = 300", "depth_raw_min <= depth_raw_max"),
        (
            "depth_scale = 0.0392156862745098",
            "depth_scale = 0.0",
            "depth_scale: expected a number > 0",
        ),
        ("y_down = true", 'y_down = "no"', 'y_down: expected true or false, got "no"'),
        ("accuracy_scale = 10.0", "accuracy_scale = -1.0", "accuracy_scale: expected a number > 0"),
        ("y_down = true", "y_down = true\nrecorded_at = 4", "recorded_at: expected a table"),
        ('room = "west"', "", r"rooms\[0\].room: missing"),
        ("[0.0, 0.0, 4.0, 6.0]", "[0.0, 0.0, 4.0]", "a list of length 4, got 3"),
        (
            "[0.0, 0.0, 4.0, 6.0]",
            '["a", 0.0, 4.0, 6.0]',
            r"rectangles\[0\]\[0\]: expected a number",
        ),
    ],
)
def test_an_invalid_header_is_rejected(tmp_path: Path, old: str, new: str, hint: str) -> None:
    path = pairs.manifest(tmp_path / "data")
    _edit(path.with_suffix(".toml"), old, new)
    with pytest.raises(RequestError, match=hint):
        ingest("csv", path, tmp_path / "s.s2r")


def test_a_depth_image_of_another_type_is_skipped(tmp_path: Path) -> None:
    path = pairs.manifest(tmp_path / "data")
    file = path.parent / "sim" / "3_depth.png"
    cv2.imwrite(str(file), cv2.imread(str(file), cv2.IMREAD_UNCHANGED).astype(np.uint16) * 250)
    scan = ingest("csv", path, tmp_path / "s.s2r")
    assert [(p.kind, p.file) for p in scan.issues] == [("mixed depth types", "sim/3_depth.png")]
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == 11
        assert store.frame(0, "sim").depth.dtype == np.uint8


def test_the_example_of_a_header_in_the_documentation_is_valid(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs/how-to/your-data.md").read_text()
    (example,) = (
        block for block in re.findall(r"```toml\n(.*?)```", page, re.S) if "[domains.sim]" in block
    )
    (tmp_path / "lab.toml").write_text(example)
    config = DatasetConfig(tmp_path / "lab.toml")
    assert config.domain("sim", (256, 256)).kind == "sim"
    assert config.domain("real", (256, 256)).depth_raw_max == 10_000
    assert config.image_sizes("real") == ((480, 640), (240, 320))
    scan = config.empty_scan(tmp_path, (256, 256), PathContainment(tmp_path, False))
    assert [room.room for room in scan.rooms] == ["hall", "hall"]
    used = set(re.findall(r"^\s*(\w+) =|[{,] (\w+) =", example, re.M))
    named = {first or second for first, second in used}
    tables = (
        DatasetTable,
        BoundsTable,
        RoomTable,
        DomainTable,
        FieldOfViewCamera,
        IntrinsicsCamera,
    )
    keys = {field.name for table in tables for field in msgspec.structs.fields(table)}
    assert keys - {"bounds", "recorded_at", "rooms", "domains"} <= named
