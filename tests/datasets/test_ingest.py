"""Ingest of both layouts stores valid data losslessly."""

import json
import shutil
import tomllib
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.maintenance.verify import verify
from s2rtools.common.read_ahead import map_ahead
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import ScanOptions
from tests.datasets.helpers import SIZE, ingest, kinds
from tests.support import pairs


def test_pairs_are_stored_in_recording_order(tmp_path):
    header = pairs.sim2realviz(tmp_path / "data", n=8, trajectories=("t2", "t1"), edit=True)
    store_path = tmp_path / "s.s2r"
    scan = ingest("sim2realviz", tmp_path / "data", store_path, header=header)
    assert scan.issues == []
    assert verify(store_path) == []
    with s2rstore.open(store_path) as store:
        assert [t.trajectory for t in store.trajectories] == ["t1", "t2"]
        assert set(store.domains) == {"sim", "real", "sim_edit"}
        x, y, heading = (np.array(c) for c in zip(*pairs.circular_poses(8), strict=True))
        truth = store.instances
        assert np.allclose(truth.x, np.tile(x, 2))
        assert np.allclose(truth.y, np.tile(y, 2))
        heading_errors = angles.distance(truth.heading, np.tile(heading, 2))
        assert np.degrees(heading_errors).max() <= 0.51
        rooms = np.where(x <= 4, "west", "east")
        assert [truth.room_names[c] for c in truth.room[:8]] == rooms.tolist()
        assert truth.odom_x[0] == pytest.approx(-y[0])
        frame = store.frame("real", 3)
        source = scan.trajectories["t1"][3].sources["real"]
        raw = cv2.imread(str(source.files[1]), cv2.IMREAD_UNCHANGED)
        assert set(np.unique(frame.depth)) <= set(np.unique(raw))
        assert (frame.valid == ((frame.depth >= 6) & (frame.depth <= 249))).all()
        rgb = cv2.cvtColor(cv2.imread(str(source.files[0])), cv2.COLOR_BGR2RGB)
        assert (frame.rgb == cv2.resize(rgb, SIZE[::-1], interpolation=cv2.INTER_AREA)).all()


def test_intrinsics_follow_the_resize(data, tmp_path):
    ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])
    with s2rstore.open(tmp_path / "s.s2r") as store:
        camera = store.domains["sim"].depth
        f = 32 / np.tan(np.radians(40))
        assert camera.fx == pytest.approx(f * 32 / 64)
        assert camera.fy == pytest.approx(f * 32 / 48)
        assert (camera.cx, camera.cy) == (16, 16)
        assert store.domains["real"].rgb.pitch == pytest.approx(np.radians(2))


def test_the_repository_root_and_a_chosen_trajectory_can_be_ingested(tmp_path):
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


def test_match_csv_may_have_a_bom_spaces_blank_lines_and_crlf(data, tmp_path):
    path = data[0] / "traj1" / "sim" / "match.csv"
    rows = [row.replace(",", " , ") for row in path.read_text().splitlines()]
    path.write_bytes("\r\n".join(["\ufeff " + rows[0], *rows[1:], "", " , ", ""]).encode())
    assert ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1]).issues == []


def test_two_real_images_may_share_a_sim_image(data, tmp_path):
    path = data[0] / "traj1" / "sim" / "match.csv"
    rows = path.read_text().splitlines()
    rows[2] = f"{rows[2].split(',')[0]},{rows[1].split(',')[1]}"
    path.write_text("\n".join(rows) + "\n")
    scan = ingest("sim2realviz", data[0], tmp_path / "s.s2r", header=data[1])
    assert kinds(scan) == {"unmatched image": 2}
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert len(store.instances) == 8


@pytest.mark.parametrize("leftover", ["nothing", "an empty folder"])
def test_a_trajectory_may_lack_an_edited_simulator(tmp_path, leftover):
    header = pairs.sim2realviz(tmp_path / "data", 6, ("traj1", "traj2"), edit=True)
    edited = tmp_path / "data" / "traj2" / "sim_edit"
    shutil.rmtree(edited)
    if leftover != "nothing":
        edited.mkdir()
    scan = ingest("sim2realviz", tmp_path / "data", tmp_path / "all.s2r", header=header)
    assert kinds(scan) == ({} if leftover == "nothing" else {"empty folder": 1})
    with s2rstore.open(tmp_path / "all.s2r") as store:
        assert set(store.domains) == {"sim", "real", "sim_edit"}
        assert store.imaged("sim", "real").all()
        assert store.imaged("sim_edit").tolist() == [True] * 6 + [False] * 6
    assert verify(tmp_path / "all.s2r") == []


@pytest.mark.parametrize(("bits", "dtype"), [(8, "uint8"), (16, "uint16")])
def test_a_manifest_is_ingested(tmp_path, bits, dtype):
    path = pairs.manifest(tmp_path / "data", 12, bits)
    (header,) = path.parent.glob("*.toml")
    header.write_text(f"recall_thresholds = [[0.1, 5], [3, 20]]\n{header.read_text()}")
    scan = ingest("csv", path, tmp_path / "s.s2r")
    assert scan.issues == []
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert [t.instances for t in store.trajectories] == [6, 6]
        frame = store.frame("sim", 0)
        assert frame.depth.dtype == dtype
        assert store.dataset.accuracy_scale == 10
        assert store.dataset.recall_thresholds == ((0.1, 5), (3, 20))
        assert np.allclose(store.instances.timestamp, 0.1 * np.arange(12))
        expected = [a for *_, a in pairs.circular_poses(12)]
        assert angles.distance(store.instances.heading, expected).max() < 1e-5
    assert verify(tmp_path / "s.s2r") == []


def test_trajectories_of_a_manifest_may_have_one_side(tmp_path):
    path = pairs.manifest(tmp_path / "data", 12)
    header, *rows = path.read_text().splitlines()
    names = header.split(",")
    trajectory, domain = names.index("trajectory"), names.index("domain")
    last = max(row.split(",")[trajectory] for row in rows)
    kept = [r for r in rows if (v := r.split(","))[trajectory] != last or v[domain] != "real"]
    path.write_text("\n".join([header, *kept]) + "\n")
    assert ingest("csv", path, tmp_path / "mixed.s2r").issues == []
    sim = [row for row in rows if row.split(",")[domain] == "sim"]
    path.write_text("\n".join([header, *sim]) + "\n")
    assert ingest("csv", path, tmp_path / "sim.s2r").issues == []
    path.write_text("\n".join([header, *kept[:-1], rows[-1]]) + "\n")
    scan = IMPORTERS["csv"](path, ScanOptions(frame=SIZE))
    assert kinds(scan)["unmatched pair"] == 6
    for name, real in (("mixed", [True] * 6 + [False] * 6), ("sim", [False] * 12)):
        with s2rstore.open(tmp_path / f"{name}.s2r") as store:
            assert store.imaged("sim").all()
            if "real" in store.domains:
                assert store.imaged("real").tolist() == real
        assert verify(tmp_path / f"{name}.s2r") == []


def test_depth_images_may_have_another_size(tmp_path):
    path = pairs.manifest(tmp_path / "data")
    for file in path.parent.glob("*/*_depth.png"):
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        cv2.imwrite(str(file), cv2.resize(image, (32, 24), interpolation=cv2.INTER_NEAREST))
    header = path.with_suffix(".toml")
    depth_camera = "depth = { hfov = 80.0, width = 32, height = 24 }"
    header.write_text(header.read_text().replace("depth = { hfov = 80.0 }", depth_camera))
    assert ingest("csv", path, tmp_path / "s.s2r").issues == []
    with s2rstore.open(tmp_path / "s.s2r") as store:
        camera = store.domains["sim"]
        assert camera.depth == camera.rgb


def test_a_json_header_is_equivalent(tmp_path):
    path = pairs.manifest(tmp_path / "data")
    header = path.with_suffix(".toml")
    path.with_suffix(".json").write_text(json.dumps(tomllib.loads(header.read_text())))
    header.rename(header.with_name("other.toml"))
    ingest("csv", path, tmp_path / "a.s2r")
    ingest("csv", path, tmp_path / "b.s2r", header=header.with_name("other.toml"))
    with s2rstore.open(tmp_path / "a.s2r") as a, s2rstore.open(tmp_path / "b.s2r") as b:
        assert a.dataset.hash == b.dataset.hash


def test_prefetched_work_is_ordered_and_bounded():
    started: list[int] = []

    def work(item: int) -> int:
        started.append(item)
        return item * item

    with ThreadPoolExecutor(2) as pool:
        results = map_ahead(pool, work, range(50), window=4)
        assert next(results) == 0
        assert len(started) <= 5
        assert list(results) == [i * i for i in range(1, 50)]


@pytest.mark.real
def test_the_real_data_set_is_ingested(real_data, tmp_path):
    scan = IMPORTERS["sim2realviz"](real_data, ScanOptions())
    assert kinds(scan) == {}
    assert {name: len(rows) for name, rows in scan.trajectories.items()} == {"traj1": 542}
    assert set(scan.domains) == {"sim", "real", "sim_edit"}
    records = scan.trajectories["traj1"]
    x = np.array([s.x for s in records])
    y = np.array([s.y for s in records])
    inside = [set[str]() for _ in records]
    for r in scan.rooms:
        for i in np.flatnonzero((x >= r.x0) & (x <= r.x1) & (y >= r.y0) & (y <= r.y1)):
            inside[i].add(r.room)
    assert sum(len(rooms) > 1 for rooms in inside) == 8
    assert x.min() > scan.bounds.x0
    assert y.max() < scan.bounds.y1
