"""Files for other programs hold what the store holds, as libraries of these programs read it."""

from __future__ import annotations

import base64
import io
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import s2rstore
from s2rstore.geometry.camera import rays, to_floor
from s2rstore.records import SIDES
from s2rtui.export.load_scene import SceneOptions, open_scene
from s2rtui.export.other_programs import FORMATS, ExportContent
from s2rtui.export.other_programs.coco_images import _geometry

SELECTED = "ids(3, 7..12)"
IIDS = [3, 7, 8, 9, 10, 11, 12]


@pytest.fixture
def exported(tiny_store, tmp_path, s2r):
    def export(name: str, *options: str) -> Path:
        out = tmp_path / f"out{FORMATS[name].suffix}"
        s2r("export", tiny_store, "--to", name, "--select", SELECTED, "--out", out, *options)
        return out

    return export


def test_rerun_reads_images_poses_predictions_and_heat(exported, tiny_store):
    reader = pytest.importorskip("rerun.chunk").RrdReader
    chunks = list(reader(exported("rerun", "--heat", "occlusion")).store().stream())
    rows = {(each.entity_path, each.is_static): each for each in chunks}
    for side in SIDES:
        for name in ("camera", "camera/rgb", "camera/depth", "camera/rgb/heat", "error"):
            assert rows[f"/{side}/{name}", False].num_rows == len(IIDS)
        assert rows[f"/predicted/{side}", True].num_rows == 1
    assert {("/truth/a", True), ("/real/camera/rgb", True)} <= rows.keys()
    batch = rows["/real/camera/rgb", False].to_record_batch().to_pydict()
    blob = next(value for name, value in batch.items() if "blob" in name)
    order = np.argsort(batch["instance"])
    with s2rstore.open(tiny_store) as store:
        content = bytes(np.array(blob[order[0]][0], np.uint8))
        assert np.array_equal(Image.open(io.BytesIO(content)), store.frame("real", 3).rgb)


def test_the_mcap_reader_gives_images_depth_and_poses(exported, tiny_store):
    reader = pytest.importorskip("mcap.reader")
    topics: dict[str, list[dict]] = {}
    with exported("mcap").open("rb") as file:
        for schema, channel, message in reader.make_reader(file).iter_messages():
            assert (channel.message_encoding, schema.encoding) == ("json", "jsonschema")
            topics.setdefault(channel.topic, []).append(json.loads(message.data))
    assert len(topics["/truth"]) == len(topics["/sim/rgb"]) == len(IIDS)
    assert [each["iid"] for each in topics["/errors"]] == IIDS
    with s2rstore.open(tiny_store) as store:
        frame, domain = store.frame("real", 3), store.domain("real")
        position = topics["/real/predicted"][0]["pose"]["position"]
        hand = -1 if store.dataset.y_down else 1
        real = store.run_columns("vanilla").real
        assert (position["x"], hand * position["y"]) == pytest.approx((real.x[3], real.y[3]))
    image = Image.open(io.BytesIO(base64.b64decode(topics["/real/rgb"][0]["data"])))
    assert np.array_equal(image, frame.rgb)
    depth = np.frombuffer(base64.b64decode(topics["/real/depth"][0]["data"]), "<u2")
    expected = np.where(frame.valid, frame.depth * domain.depth_scale * 1000, 0)
    assert np.allclose(depth.reshape(frame.depth.shape), np.minimum(expected, 65_535), atol=0.5)


def test_evo_computes_the_errors_of_the_store(exported, tiny_store):
    pytest.importorskip("evo")
    from evo.core import metrics, sync
    from evo.tools import file_interface

    folder = exported("tum")
    with s2rstore.open(tiny_store) as store:
        for side in SIDES:
            paths = (str(folder / f"a-{which}.txt") for which in ("truth", side))
            both = sync.associate_trajectories(*map(file_interface.read_tum_trajectory_file, paths))
            ape = metrics.APE(metrics.PoseRelation.translation_part)
            ape.process_data(both)
            errors = getattr(store.run_columns("vanilla"), side).error[IIDS]
            assert np.allclose(ape.error, errors, atol=1e-6)


def test_a_camera_sees_depth_where_the_floor_map_has_it(tiny_store):
    with open_scene(tiny_store, SceneOptions()) as scene:
        content = ExportContent.of(scene, with_heat=False)
        domain, dataset = content.domains["real"], content.store.dataset
        pose = content.store.poses("real")[5:6]
        pixel, metres = np.array([3.5]), np.array([[[2.0]]])
        x, y, z = to_floor(rays(domain.rgb, pixel, pixel), metres, domain, pose, dataset.y_down)
        position, turn = content.camera(domain, content.in_space(pose)[0])
        lens = domain.rgb
        ray = np.array([(3.5 - lens.cx) / lens.fx, (3.5 - lens.cy) / lens.fy, 1.0])
        point = position + Rotation.from_quat(turn).apply(2.0 * ray)
        assert point == pytest.approx(
            [x.item(), -y.item() if dataset.y_down else y.item(), z.item()]
        )


def test_coco_and_fiftyone_list_the_images_with_their_facts(exported, tiny_store, tmp_path):
    coco = json.loads((exported("coco") / "annotations.json").read_text())
    assert sorted(image["iid"] for image in coco["images"]) == sorted(2 * IIDS)
    assert [each["name"] for each in coco["categories"]] == ["chair", "fire door"]
    with s2rstore.open(tiny_store) as store:
        for image in coco["images"]:
            pixels = Image.open(tmp_path / "out" / image["file_name"])
            assert np.array_equal(pixels, store.frame(image["side"], image["iid"]).rgb)
    (tmp_path / "out").rename(tmp_path / "coco")
    folder = exported("fiftyone")
    samples = json.loads((folder / "samples.json").read_text())["samples"]
    assert {sample["iid"] for sample in samples} == {*IIDS}
    assert all((folder / sample["filepath"]).is_file() for sample in samples)
    assert {*samples[0]} >= {"tags", "trajectory", "room", "x_m", "real_error_m"}


def test_run_lengths_of_a_mask_go_down_each_column():
    mask = np.array([[1, 0, 0], [1, 1, 0]], bool)
    found = _geometry(mask)
    assert found["segmentation"]["counts"] == [0, 2, 1, 1, 2]
    assert (found["area"], found["bbox"]) == (3, [0, 0, 2, 2])


def test_notes_and_tags_go_to_csv_and_back(exported, tiny_store, tmp_path, s2r):
    notes = tmp_path / "notes.csv"
    notes.write_text('iid,tags,note\n3,door dark,"a, b"\n7,door,\n')
    assert "2 instances" in s2r("import", tiny_store, notes).printed
    lines = exported("csv").read_text().splitlines()
    rows = [dict(zip(lines[0].split(","), line.split(","), strict=False)) for line in lines[1:]]
    assert [row["iid"] for row in rows] == [str(iid) for iid in IIDS]
    assert lines[1].endswith('door dark,"a, b"')
    assert rows[1]["tags"] == "door"
    notes.write_text("iid,note\n400,x\n")
    s2r("import", tiny_store, notes).assert_refused("iid '400'")
    s2r("export", tiny_store, "--to", "csv", "--out", notes).assert_refused("exists already")
