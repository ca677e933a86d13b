"""What must agree with the store, and what is reported."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.maintenance.room_names import rename_room
from s2rstore.maintenance.verify import verify
from s2rtools.datasets.appending import append as append_module
from tests.datasets.conftest import N
from tests.datasets.helpers import add, files, ingest, kinds, scan_of
from tests.support import image_folders, pairs


def test_other_images_or_poses_of_a_stored_trajectory_are_refused(tmp_path):
    manifest = pairs.manifest(tmp_path / "data")
    store = tmp_path / "s.s2r"
    ingest("csv", manifest, store, trajectories=("a",))
    before = files(store)
    text = manifest.read_text()
    first = text.splitlines()[1]
    manifest.write_text(text.replace(first.split(",")[5], "6.9"))
    with pytest.raises(RequestError, match=r"source differs .*the pose of sim/0_rgb.png"):
        add(scan_of("csv", manifest), store)
    manifest.write_text(text)
    shutil.copy(tmp_path / "data" / "sim" / "1_rgb.png", tmp_path / "data" / "sim" / "0_rgb.png")
    with pytest.raises(RequestError, match=r"trajectory a: .*\(sim/0_rgb.png or .*another name"):
        add(scan_of("csv", manifest), store)
    assert files(store) == before


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("accuracy_scale = 10.0", "accuracy_scale = 11.0", "another accuracy_scale: 11 m"),
        ("y_down = true", "y_down = false", "another y_down"),
        ("camera_height = 0.6", "camera_height = 0.7", "another camera_height of domain sim: 0.7"),
        ("hfov = 70.0", "hfov = 71.0", "another rgb_fx of domain real"),
        ("depth_raw_max = 249", "depth_raw_max = 248", "another depth_raw_max of domain sim"),
        ('kind = "sim"', 'kind = "real"', "another kind of domain sim: real, the store sim"),
    ],
)
def test_another_calibration_is_refused_by_name(source, store, tmp_path, old, new, message):
    header = tmp_path / "other.toml"
    header.write_text(source[1].read_text().replace(old, new))
    before = files(store)
    with pytest.raises(RequestError, match=message):
        add(scan_of("sim2realviz", source[0], header=header), store)
    assert files(store) == before


def test_another_frame_size_and_another_kind_of_data_are_refused(source, store, tmp_path):
    with pytest.raises(RequestError, match=r"frame size \(--size\): 48x48, the store 32x32"):
        add(scan_of("sim2realviz", source[0], header=source[1], frame=(48, 48)), store)
    folders = image_folders.folders(tmp_path / "images")
    with pytest.raises(RequestError, match="kind of data: images without poses"):
        add(scan_of("images", Path(), folders=folders), store)


def test_cameras_that_differ_by_rounding_agree(scan, store):
    domain = scan.domains["sim"]
    scan.domains["sim"] = replace(domain, depth_scale=np.nextafter(domain.depth_scale, 1))
    assert add(scan, store) == {"a": N, "b": N}


def test_no_store_is_made(scan, tmp_path):
    with pytest.raises(RequestError, match="leave out --append"):
        add(scan, tmp_path / "missing.s2r")
    assert not (tmp_path / "missing.s2r").exists()


def test_bounds_rooms_plan_and_thresholds_of_the_store_are_kept_and_others_reported(
    source, store, tmp_path
):
    text = source[1].read_text().replace("x1 = 8.0", "x1 = 6.0")
    text = text.replace("0.0, 4.0, 6.0", "0.0, 3.0, 6.0")
    header = tmp_path / "other.toml"
    header.write_text(f"recall_thresholds = [[1, 10]]\n{text}")
    with s2rstore.open(store) as opened:
        dataset, rooms = opened.dataset, opened.rooms
    other = scan_of("sim2realviz", source[0], header=header)
    other.floor_plan = np.full((40, 60, 3), 99, np.uint8)
    with pytest.raises(RequestError, match="bounds"):
        add(other, store, strict=True)
    other.issues.clear()
    add(other, store)
    assert kinds(other) == {"other bounds": 1, "other rooms": 1, "other floor plan": 1,
                            "other recall thresholds": 1}  # fmt: skip
    with s2rstore.open(store) as opened:
        assert (opened.dataset.bounds, opened.rooms) == (dataset.bounds, rooms)
        assert opened.dataset.floor_plan == dataset.floor_plan
        truth = opened.instances
        assert (truth.room[:N] == truth.room[N : 2 * N]).all()
        recorded = json.loads(opened.provenance("dataset")["append:1"])["problems"]
        assert recorded == kinds(other)


def test_other_names_of_rooms_are_not_reported(source, store, tmp_path):
    header = tmp_path / "other.toml"
    header.write_text(source[1].read_text().replace('"west"', '"front"'))
    other = scan_of("sim2realviz", source[0], header=header)
    add(other, store, strict=True)
    assert other.issues == []
    with s2rstore.open(store) as opened:
        assert list(opened.stored_rooms) == ["west", "east"]


def test_a_room_that_is_renamed_meanwhile_is_noticed(scan, store, monkeypatch):
    write_frames = append_module.write_frames

    def rename_and_write(*arguments):
        rename_room(store, "west", "hall")
        return write_frames(*arguments)

    monkeypatch.setattr(append_module, "write_frames", rename_and_write)
    with pytest.raises(RequestError, match="another process has renamed rooms; append again"):
        add(scan, store)
    monkeypatch.undo()
    add(scan, store)
    with s2rstore.open(store) as opened:
        assert set(opened.instances.room_names) == {"hall", "east"}
    assert verify(store) == []


def test_poses_outside_the_bounds_of_the_store_are_reported(scan, store):
    first, *others = scan.trajectories["a"]
    scan.trajectories["a"] = [replace(first, x=99.0), *others]
    add(scan, store)
    assert kinds(scan) == {"pose outside the bounds": 1}
