"""Ingest of both layouts: what is right is stored losslessly, what is wrong is named."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore import angles
from s2rstore.errors import RequestError
from s2rstore.verify import verify
from s2rtools.ingest import IMPORTERS
from s2rtools.ingest.build import build
from s2rtools.ingest.scan import Scan, ScanOptions
from tests.support import pairs

SIZE = (32, 32)


def ingest(layout: str, path: Path, store: Path, strict: bool = False, **options) -> Scan:
    scan = IMPORTERS[layout](path, ScanOptions(frame=SIZE, **options))
    build(scan, store, "s2r ingest", strict, lambda steps: None)
    return scan


@pytest.fixture
def data(tmp_path: Path) -> tuple[Path, Path]:
    header = pairs.sim2realviz(tmp_path / "data", n=8)
    return tmp_path / "data", header


def kinds(scan: Scan) -> dict[str, int]:
    found: dict[str, int] = {}
    for problem in scan.problems:
        found[problem.kind] = found.get(problem.kind, 0) + 1
    return found


def test_pairs_are_stored_in_recording_order(tmp_path: Path) -> None:
    header = pairs.sim2realviz(tmp_path / "data", n=8, trajectories=("t2", "t1"), edit=True)
    store_path = tmp_path / "s.s2r"
    scan = ingest("sim2realviz", tmp_path / "data", store_path, header=header)
    assert scan.problems == []
    assert verify(store_path) == []
    with s2rstore.open(store_path) as store:
        assert [t.trajectory for t in store.trajectories] == ["t1", "t2"]
        assert set(store.domains) == {"sim", "real", "sim_edit"}
        x, y, heading = (np.array(c) for c in zip(*pairs.walk(8), strict=True))
        truth = store.instances
        assert np.allclose(truth.x, np.tile(x, 2))
        assert np.allclose(truth.y, np.tile(y, 2))
        off = angles.distance(truth.heading, np.tile(heading, 2))
        assert np.degrees(off).max() <= 0.51
        rooms = np.where(x <= 4, "west", "east")
        assert [truth.room_names[c] for c in truth.room[:8]] == rooms.tolist()
        assert truth.odom_x[0] == pytest.approx(-y[0])
        frame = store.frame(3, "real")
        source = scan.trajectories["t1"][3].images["real"]
        raw = cv2.imread(str(source.depth), cv2.IMREAD_UNCHANGED)
        assert set(np.unique(frame.depth)) <= set(np.unique(raw))
        assert (frame.valid == ((frame.depth >= 6) & (frame.depth <= 249))).all()
        rgb = cv2.cvtColor(cv2.imread(str(source.rgb)), cv2.COLOR_BGR2RGB)
        assert (frame.rgb == cv2.resize(rgb, SIZE[::-1], interpolation=cv2.INTER_AREA)).all()


def test_intrinsics_follow_the_resize(data, tmp_path: Path) -> None:
    ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])
    with s2rstore.open(tmp_path / "s.s2r") as store:
        camera = store.domains["sim"].depth
        f = 32 / np.tan(np.radians(40))
        assert camera.fx == pytest.approx(f * 32 / 64)
        assert camera.fy == pytest.approx(f * 32 / 48)
        assert (camera.cx, camera.cy) == (16, 16)
        assert store.domains["real"].rgb.pitch == pytest.approx(np.radians(2))


def test_the_repositorys_root_and_a_chosen_trajectory(tmp_path: Path) -> None:
    root = tmp_path / "repo"
    header = pairs.sim2realviz(root / "data_source" / "traj_cap", 6, ("traj1", "traj2"))
    (root / "static" / "assets" / "images").mkdir(parents=True)
    plan = np.full((40, 60, 3), 200, np.uint8)
    cv2.imwrite(str(root / "static" / "assets" / "images" / "map.jpg"), plan)
    ingest("sim2realviz", root, tmp_path / "s.s2r", header=header, trajectories=("traj2",))
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert [t.trajectory for t in store.trajectories] == ["traj2"]
        path = store.floor_plan_path()
        assert path is not None
        assert cv2.imread(str(path)).shape == (40, 60, 3)
    with pytest.raises(RequestError, match="--trajectory traj9"):
        ingest("sim2realviz", root, tmp_path / "t.s2r", header=header, trajectories=("traj9",))


def _first(root: Path, domain: str, what: str) -> Path:
    return sorted((root / "traj1" / domain).glob(f"*_{what}.jpeg"))[0]


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


def _missing(root: Path) -> None:
    _first(root, "real", "depth").unlink()


def _bad_row(root: Path) -> None:
    with (root / "traj1" / "sim" / "match.csv").open("a") as file:
        file.write("what.jpeg,ever.jpeg\n")


def _nan_pose(root: Path) -> None:
    path = root / "traj1" / "sim" / "match.csv"
    rows = path.read_text().splitlines()
    real, sim = rows[1].split(",")
    for what in ("rgb", "depth"):
        old = root / "traj1" / "sim" / sim.replace("_rgb", f"_{what}")
        old.rename(old.with_name(f"xnan_y0.047_z1.0_r4_{what}.jpeg"))
    rows[1] = f"{real},xnan_y0.047_z1.0_r4_rgb.jpeg"
    path.write_text("\r\n".join(rows) + "\r\n")


def _duplicate(root: Path) -> None:
    path = root / "traj1" / "sim" / "match.csv"
    path.write_text(path.read_text() + path.read_text().splitlines()[1] + "\n")


@pytest.mark.parametrize(
    ("harm", "kind", "left"),
    [
        (_truncate, "truncated image", 7),
        (_garbage, "unreadable image", 7),
        (_empty, "unreadable image", 7),
        (_wrong_size, "wrong size", 7),
        (_colour_depth, "not a depth image", 7),
        (_missing, "missing image", 7),
        (_bad_row, "bad name", 8),
        (_nan_pose, "bad pose", 7),
        (_duplicate, "duplicate row", 8),
    ],
)
def test_bad_input_is_named_left_out_and_refused_when_strict(
    data, tmp_path: Path, harm, kind: str, left: int
) -> None:
    harm(data[0])
    with pytest.raises(RequestError, match="nothing was ingested"):
        ingest("sim2realviz", data[0], tmp_path / "strict.s2r", strict=True, header=data[1])
    assert not list(tmp_path.glob("*strict.s2r*"))
    scan = ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])
    assert kind in kinds(scan)
    assert all(problem.file for problem in scan.problems)
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == left
        assert store.instances.seq.tolist() == list(range(left))
    assert verify(tmp_path / "s.s2r") == []


def test_images_without_a_row_are_reported(data, tmp_path: Path) -> None:
    extra = _first(data[0], "real", "rgb")
    shutil.copy(extra, extra.with_name("x9.000_y9.000_z0.000_r9_rgb.jpeg"))
    scan = ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])
    assert kinds(scan) == {"unmatched image": 1}


@pytest.mark.parametrize("make", ["nothing", "empty", "no images"])
def test_empty_folders_are_refused(tmp_path: Path, make: str) -> None:
    root = tmp_path / "data"
    if make != "nothing":
        for domain in ("sim", "real"):
            (root / "traj1" / domain).mkdir(parents=True)
    if make == "no images":
        (root / "traj1" / "sim" / "match.csv").write_text("REAL_RGB,SIM_RGB\n")
    with pytest.raises(RequestError):
        ingest("sim2realviz", root, tmp_path / "s.s2r")
    assert not (tmp_path / "s.s2r").exists()


def test_an_existing_store_is_never_overwritten(data, tmp_path: Path) -> None:
    ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])
    with pytest.raises(RequestError, match="exists"):
        ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])


@pytest.mark.parametrize(("bits", "dtype"), [(8, "uint8"), (16, "uint16")])
def test_a_manifest(tmp_path: Path, bits: int, dtype: str) -> None:
    path = pairs.manifest(tmp_path / "data", 12, bits)
    scan = ingest("csv", path, tmp_path / "s.s2r")
    assert scan.problems == []
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert [t.instances for t in store.trajectories] == [6, 6]
        frame = store.frame(0, "sim")
        assert frame.depth.dtype == dtype
        assert store.dataset.accuracy_scale == 10
        assert np.allclose(store.instances.timestamp, 0.1 * np.arange(12))
        wanted = [a for *_, a in pairs.walk(12)]
        assert angles.distance(store.instances.heading, wanted).max() < 1e-5
    assert verify(tmp_path / "s.s2r") == []


def _edited(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    ("old", "new", "kind"),
    [
        ("a,0,real", "a,zero,real", "bad seq"),
        ("a,0,real", "a,0,sim", "duplicate row"),
        ("sim/1_rgb.png", "sim/no_rgb.png", "missing image"),
        (",7.0,", ",nan,", "bad pose"),
    ],
)
def test_a_manifests_problems_are_named(tmp_path: Path, old: str, new: str, kind: str) -> None:
    path = pairs.manifest(tmp_path / "data")
    _edited(path, old, new)
    scan = ingest("csv", path, tmp_path / "s.s2r")
    assert kind in kinds(scan)
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == 11


@pytest.mark.parametrize(
    ("old", "new", "hint"),
    [
        ('kind = "real"', 'kind = "other"', 'kind = "sim" or "real"'),
        ("x1 = 8.0", "x1 = -8.0", "larger"),
        ("hfov = 80.0", "hfov = true", "must be a number"),
        ("[bounds]", "[bounds", "data.toml"),
        ("[domains.real]", "[domains.elsewhere]", "domains.real"),
    ],
)
def test_a_wrong_header_is_refused(tmp_path: Path, old: str, new: str, hint: str) -> None:
    path = pairs.manifest(tmp_path / "data")
    _edited(path.with_suffix(".toml"), old, new)
    with pytest.raises(RequestError, match=hint):
        ingest("csv", path, tmp_path / "s.s2r")


@pytest.mark.real
def test_the_real_data(real_data: Path, tmp_path: Path) -> None:
    scan = IMPORTERS["sim2realviz"](real_data, ScanOptions())
    assert kinds(scan) == {}
    assert {name: len(rows) for name, rows in scan.trajectories.items()} == {"traj1": 542}
    assert set(scan.domains) == {"sim", "real", "sim_edit"}
    sightings = scan.trajectories["traj1"]
    x = np.array([s.x for s in sightings])
    y = np.array([s.y for s in sightings])
    inside = [set[str]() for _ in sightings]
    for r in scan.rooms:
        for i in np.flatnonzero((x >= r.x0) & (x <= r.x1) & (y >= r.y0) & (y <= r.y1)):
            inside[i].add(r.room)
    assert sum(len(rooms) > 1 for rooms in inside) == 8
    assert x.min() > scan.bounds.x0
    assert y.max() < scan.bounds.y1
