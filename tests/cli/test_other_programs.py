"""Files for other programs hold what the store holds, as libraries of these programs read it."""

import base64
import io
import json
from contextlib import suppress
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import s2rstore
from s2rstore.geometry.camera import rays, to_floor
from s2rstore.records import SIDES
from s2rtui.export.load_scene import SceneOptions, open_scene
from s2rtui.export.other_programs import FORMATS, ExportContent, tum_trajectories
from s2rtui.export.other_programs.coco_images import _geometry
from tests.support import hostile

IIDS = [3, 7, 8, 9, 10, 11, 12]


@pytest.fixture
def exported(tiny_store, tmp_path, s2r):
    def export(name: str, *options: str) -> Path:
        out = tmp_path / f"{name}{FORMATS[name].suffix}"
        selected = ("--select", "ids(3, 7..12)")
        s2r("export", tiny_store, "--to", name, *selected, "--out", out, *options)
        return out

    return export


@pytest.fixture
def store(tiny_store):
    with s2rstore.open(tiny_store) as opened:
        yield opened


def test_rerun_reads_images_poses_predictions_and_heat(exported, store):
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
    content = bytes(np.array(blob[int(np.argmin(batch["instance"]))][0], np.uint8))
    assert np.array_equal(Image.open(io.BytesIO(content)), store.frame("real", 3).rgb)


def test_the_mcap_reader_gives_images_depth_and_poses(exported, store):
    reader = pytest.importorskip("mcap.reader")
    topics: dict[str, list[dict]] = {}
    with exported("mcap").open("rb") as file:
        for _, channel, message in reader.make_reader(file).iter_messages():
            topics.setdefault(channel.topic, []).append(json.loads(message.data))
    assert [each["iid"] for each in topics["/errors"]] == IIDS
    frame, domain = store.frame("real", 3), store.domain("real")
    real = store.run_columns("vanilla").real
    position = topics["/real/predicted"][0]["pose"]["position"]
    hand = -1 if store.dataset.y_down else 1
    assert (position["x"], hand * position["y"]) == pytest.approx((real.x[3], real.y[3]))
    image = Image.open(io.BytesIO(base64.b64decode(topics["/real/rgb"][0]["data"])))
    assert np.array_equal(image, frame.rgb)
    depth = np.frombuffer(base64.b64decode(topics["/real/depth"][0]["data"]), "<u2")
    expected = np.where(frame.valid, frame.depth * domain.depth_scale * 1000, 0)
    assert np.allclose(depth.reshape(frame.depth.shape), np.minimum(expected, 65_535), atol=0.5)


def test_evo_computes_the_errors_of_the_store(exported, store):
    pytest.importorskip("evo")
    from evo.core import metrics, sync
    from evo.tools.file_interface import read_tum_trajectory_file as read

    folder = exported("tum")
    for side in SIDES:
        both = sync.associate_trajectories(
            *(read(str(folder / f"a-{name}.txt")) for name in ("truth", side))
        )
        ape = metrics.APE(metrics.PoseRelation.translation_part)
        ape.process_data(both)
        errors = getattr(store.run_columns("vanilla"), side).error[IIDS]
        assert np.allclose(ape.error, errors, atol=1e-6)


def test_a_camera_sees_depth_where_the_floor_map_has_it(tiny_store):
    with open_scene(tiny_store, SceneOptions()) as scene:
        content = ExportContent.of(scene, with_heat=False)
        domain, y_down = content.domains["real"], content.store.dataset.y_down
        pose, lens = content.store.poses("real")[5:6], content.domains["real"].rgb
        pixel = np.array([3.5])
        x, y, z = to_floor(rays(lens, pixel, pixel), np.full((1, 1, 1), 2.0), domain, pose, y_down)
        position, turn = content.camera(domain, content.in_space(pose)[0])
        ray = np.array([(3.5 - lens.cx) / lens.fx, (3.5 - lens.cy) / lens.fy, 1.0])
        point = position + Rotation.from_quat(turn).apply(2.0 * ray)
        assert point == pytest.approx([x.item(), -y.item() if y_down else y.item(), z.item()])


def test_coco_and_fiftyone_list_the_images_with_their_facts(exported, store):
    coco, fiftyone = exported("coco"), exported("fiftyone")
    images = json.loads((coco / "annotations.json").read_text())["images"]
    samples = json.loads((fiftyone / "samples.json").read_text())["samples"]
    for folder, rows, name in ((coco, images, "file_name"), (fiftyone, samples, "filepath")):
        assert sorted(row["iid"] for row in rows) == sorted(2 * IIDS)
        for row in rows:
            rgb = store.frame(row["side"], row["iid"]).rgb
            assert np.array_equal(Image.open(folder / row[name]), rgb)
            assert {*row} >= {"trajectory", "room", "x_m", "real_error_m"}
    found = _geometry(np.array([[1, 0, 0], [1, 1, 0]], bool))
    assert found["segmentation"]["counts"] == [0, 2, 1, 1, 2]
    assert (found["area"], found["bbox"]) == (3, [0, 0, 2, 2])


def test_notes_and_tags_go_to_csv_and_back(exported, tiny_store, tmp_path, s2r):
    notes = tmp_path / "notes.csv"
    notes.write_text('iid,tags,note\n3,door dark,"a, b"\n7,@door #door,=1\n8,,\n')
    for count in ("2 instances", "0 instances"):
        assert count in s2r("import", tiny_store, notes).printed
    first, second = exported("csv", "--safe-csv").read_text().splitlines()[1:3]
    assert first.endswith('"door dark","a, b"')
    assert second.endswith('"door","\'=1"')
    for row, message in (("400,", "iid '400'"), ("9" * 5000, "iid '999"), ('1,a"', "tag:")):
        notes.write_text(f"iid,tags\n{row}\n")
        s2r("import", tiny_store, notes).assert_refused(f"{notes}:2: {message}")
    s2r("export", tiny_store, "--to", "csv", "--out", notes).assert_refused("exists already")


def test_an_export_appears_when_it_is_complete(store_copy, tmp_path, s2r):
    renamed = "SET trajectory = if(trajectory = 'a', 'a+b', 'a_b')"
    hostile.edit(store_copy, f"UPDATE trajectory {renamed}", f"UPDATE instance {renamed}")
    words = "export", store_copy, "--out", tmp_path / "no" / "x.rrd", "--to", "rerun"
    s2r(*words).assert_refused("there is no folder")
    for option in ("--title a", "--cmap viridis", "--heat harm", "--safe-csv", "--clip"):
        s2r(*words[:-1], "coco", *option.split()).assert_refused("takes only")
    words = "export", store_copy, "--out", tmp_path / "tum", "--to", "tum"
    with pytest.MonkeyPatch.context() as patch, suppress(KeyboardInterrupt):
        patch.setattr(tum_trajectories, "_lines", Mock(side_effect=KeyboardInterrupt))
        s2r(*words)
    assert [path for path in tmp_path.iterdir() if path != store_copy] == []
    s2r(*words)
    assert {"a+b-sim.txt", "a_b-sim.txt"} <= {path.name for path in (tmp_path / "tum").iterdir()}
