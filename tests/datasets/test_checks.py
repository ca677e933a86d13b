"""Invalid input is reported and skipped, and rejected with --strict."""

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
from s2rtui.cli import main
from tests.datasets.helpers import ingest, kinds, scan_of
from tests.support import pairs


def _match(root: Path) -> Path:
    return root / "traj1" / "sim" / "match.csv"


def _file(root: Path, pair: int, domain: str, image: str) -> Path:
    """An image of a pair, counted from 0 in the order of the rows."""
    names = _match(root).read_text().splitlines()[1 + pair].split(",")
    name = names[domain == "sim"].replace("_rgb", f"_{image}")
    return root / "traj1" / domain / name


def _damage_images(root: Path) -> None:
    """Damage one image of each of the first eight pairs in another way."""
    truncated = _file(root, 0, "real", "rgb")
    truncated.write_bytes(truncated.read_bytes()[:-200])
    _file(root, 1, "sim", "depth").write_bytes(b"not a picture")
    _file(root, 2, "sim", "rgb").write_bytes(b"")
    cv2.imwrite(str(_file(root, 3, "real", "depth")), np.zeros((20, 30), np.uint8))
    shutil.copy(_file(root, 4, "real", "rgb"), _file(root, 4, "real", "depth"))
    grey = cv2.imread(str(_file(root, 5, "real", "rgb")), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(_file(root, 5, "real", "depth")), grey)
    _file(root, 6, "real", "depth").unlink()
    for image in ("rgb", "depth"):
        old = _file(root, 7, "sim", image)
        old.rename(old.with_name(f"xnan_y0.047_z1.0_r4_{image}.jpeg"))
    rows = _match(root).read_text().splitlines()
    rows[8] = rows[8].split(",")[0] + ",xnan_y0.047_z1.0_r4_rgb.jpeg"
    _match(root).write_text("\r\n".join(rows) + "\r\n")


def _damage_rows(root: Path) -> None:
    """What takes away no instance: rows, the header, further files and the size of all images."""
    for path in (root / "traj1").rglob("*.jpeg"):
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(path), cv2.resize(image, (32, 24)))
    depth = _file(root, 0, "real", "depth")
    shutil.copy(depth, depth.with_name("x9.000_y9.000_z0.000_r9_depth.jpeg"))
    rgb = _file(root, 0, "real", "rgb")
    shutil.copy(rgb, rgb.with_name("x8.000_y9.000_z0.000_r9_rgb.jpeg"))
    rows = _match(root).read_text().splitlines()
    paired_twice = f"{rows[1].split(',')[0]},{rows[3].split(',')[1]}"
    rows += [rows[1], paired_twice, "what.jpeg,ever.jpeg"]
    _match(root).write_text("\n".join(rows) + "\n")
    header = root / "calibration.toml"
    header.write_text(header.read_text().replace("x1 = 8.0", "x1 = 6.9"))
    (root / "map.jpg").write_bytes(b"not a picture")


@pytest.mark.parametrize(
    ("damage", "expected", "remaining"),
    [
        (
            _damage_images,
            {"truncated image": 1, "unreadable image": 2, "wrong size": 1, "missing image": 1,
             "not a depth image": 2, "bad pose": 1},
            2,
        ),
        (
            _damage_rows,
            {"duplicate row": 2, "unmatched image": 2, "pose outside the bounds": 1,
             "unreadable floor plan": 1, "other size than calibrated": 2, "bad name": 1},
            10,
        ),
    ],
)  # fmt: skip
def test_invalid_input_is_reported_and_skipped_or_rejected_if_strict(
    tmp_path, damage, expected, remaining
):
    root = tmp_path / "data"
    header = pairs.sim2realviz(root, n=10)
    damage(root)
    with pytest.raises(RequestError, match="nothing was ingested"):
        ingest("sim2realviz", root, tmp_path / "strict.s2r", strict=True, header=header)
    assert not list(tmp_path.glob("*strict.s2r*"))
    scan = ingest("sim2realviz", root, tmp_path / "s.s2r", header=header)
    assert kinds(scan) == expected
    assert all(issue.file for issue in scan.issues)
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == remaining
        assert store.instances.seq.tolist() == list(range(remaining))
    assert verify(tmp_path / "s.s2r") == []


def test_empty_folders_are_rejected(tmp_path):
    root = tmp_path / "data"
    for content in ("nothing", "empty", "no images"):
        if content == "empty":
            for domain in ("sim", "real"):
                (root / "traj1" / domain).mkdir(parents=True)
        if content == "no images":
            _match(root).write_text("REAL_RGB,SIM_RGB\n")
        with pytest.raises(RequestError):
            ingest("sim2realviz", root, tmp_path / "s.s2r")
        assert not (tmp_path / "s.s2r").exists()


def _edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.fixture(scope="module")
def manifest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A manifest of 12 pairs that no test modifies."""
    return pairs.manifest(tmp_path_factory.mktemp("manifest") / "data")


def test_problems_of_a_manifest_are_reported(manifest, tmp_path):
    text = manifest.read_text()
    path = manifest.with_name("other.csv")
    shutil.copy(manifest.with_suffix(".toml"), path.with_suffix(".toml"))
    for old, new, kind in (
        ("a,0,real", "a,zero,real", "bad seq"),
        ("a,0,real", "a,0,sim", "duplicate row"),
        ("a,0,real", ",0,real", "incomplete row"),
        ("a,0,real,", "a,0,real,,", "incomplete row"),
        (",7.0,", ",nan,", "bad pose"),
    ):
        assert old in text
        path.write_text(text.replace(old, new, 1))
        scan = scan_of("csv", path)
        assert kind in kinds(scan), new
        assert sum(map(len, scan.trajectories.values())) == 11, new
    path.write_text(text.replace("sim/1_rgb.png", "sim/no_rgb.png", 1))
    scan = ingest("csv", path, tmp_path / "s.s2r")
    assert "missing image" in kinds(scan)
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == 11


@pytest.mark.parametrize(
    ("old", "new", "hint"),
    [
        ('kind = "real"', 'kind = "other"', 'kind = "sim" or "real"'),
        ("x1 = 8.0", "x1 = -8.0", "larger"),
        ("[bounds]", "[bounds", "data.toml"),
        ("[domains.real]", "[domains.elsewhere]", "domains.real"),
        ("width = 64", "width = 0", "rgb.width: expected a number > 0, got 0"),
        ("y_down", "recall_thresholds = [[1, 10], [1, 20]]\ny_down", "not 1 to 8 pairs"),
        ("y_down", "y_donw", "data.toml: y_donw: unknown key; did you mean y_down?"),
        ("[[rooms]]", "[[rooms]]\nnmae = 1", r"rooms\[0\].nmae: unknown key; known: room, rect"),
        ("hfov = 80.0", "hfov = 80.0, fx = 20", "sim.rgb.fx: unknown key"),
        ("hfov = 80.0", "hfov = 180.0", "hfov: expected a number <= 179, got 180"),
        ("hfov = 80.0", "fx = 10", "sim.rgb.fy: missing"),
        ("depth_raw_min = 6", "depth_raw_min = 300", "depth_raw_min <= depth_raw_max"),
        ("y_down = true", 'y_down = "no"', 'y_down: expected true or false, got "no"'),
        ('room = "west"', "", r"rooms\[0\].room: missing"),
        ("[0.0, 0.0, 4.0, 6.0]", "[0.0, 0.0, 4.0]", "a list of length 4, got 3"),
    ],
)
def test_an_invalid_header_is_rejected(manifest, tmp_path, old, new, hint):
    header = tmp_path / "data.toml"
    shutil.copy(manifest.with_suffix(".toml"), header)
    _edit(header, old, new)
    with pytest.raises(RequestError, match=hint):
        ingest("csv", manifest, tmp_path / "s.s2r", header=header)


def test_the_example_of_a_header_in_the_documentation_is_valid(tmp_path):
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
        DatasetTable, BoundsTable, RoomTable, DomainTable, FieldOfViewCamera, IntrinsicsCamera,
    )  # fmt: skip
    keys = {field.name for table in tables for field in msgspec.structs.fields(table)}
    assert keys - {"bounds", "recorded_at", "rooms", "domains"} <= named


TOO_LONG = "a" * 100_000 + ".png"


def test_a_manifest_with_a_too_long_name_loses_that_pair(tmp_path, capsys):
    manifest = pairs.manifest(tmp_path / "data", n=3)
    text = manifest.read_text().replace("sim/1_rgb.png", TOO_LONG)
    manifest.write_text(text)
    store = tmp_path / "s.s2r"
    assert main(["ingest", "csv", str(manifest), "--store", str(store), "--size", "32"]) == 0
    errors = capsys.readouterr().err
    assert "missing image: 1\n  aaa" in errors
    assert len(errors) < 2000
    with s2rstore.open(store) as opened:
        assert len(opened.instances) == 2


@pytest.mark.parametrize(
    "name",
    [TOO_LONG, "a/" * 50_000, "a\0b", "\0/b", "\ud800"],
    ids=["long", "deep", "nul", "nul folder", "surrogate"],
)
def test_a_name_that_no_file_can_have_is_not_found_and_not_repeated_in_full(tmp_path, name):
    containment = PathContainment(tmp_path)
    assert containment.find_file(name, "list.txt:3") is None
    with pytest.raises(RequestError, match=r"list\.txt:3: .* is not a file name") as error:
        containment.resolve(name, "list.txt:3")
    assert len(str(error.value)) < 300
