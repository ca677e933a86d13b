"""Label images: imported as they are, selected by, and worth what restoring their pixels gains."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy import ndimage

import s2rstore
from s2rstore.language import evaluation
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import check
from s2rstore.reader import Store
from s2rtools.inference import Backend
from s2rtools.labels.label_sources import LabelSource
from s2rtools.labels.write_labels import write_labels
from s2rtools.models.load_model import load_model
from s2rtools.models.preprocessing import preprocess
from s2rtools.precompute.label_gains import image_gains
from s2rtui.charts.map import VIEW as MAP
from tests.support.application import press, running
from tests.support.copies import copy_store

RUN = "vanilla"


def restored_error(store: Store, iid: int, pixels: np.ndarray) -> float:
    """Position error on a real image that shows the simulated one at some pixels (H, W)."""
    sim, real = store.frame("sim", iid), store.frame("real", iid)
    rgb, depth = real.rgb.copy(), real.depth.copy()
    rgb[pixels], depth[pixels] = sim.rgb[pixels], sim.depth[pixels]
    model, domain = load_model(store, RUN), store.domain("real")
    valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    x = preprocess(rgb[None], depth[None], domain.depth_scale, model.contract, valid[None])
    pose = Backend(model).forward_all(x).pose[0]
    return float(np.hypot(*(pose[:2] - store.poses("real")[iid, :2])))


def test_the_gain_of_an_object_is_that_of_restoring_its_pixels(objects_world, tmp_path):
    """The object is a changed segment, restored by an independent forward pass."""
    path = copy_store(objects_world, tmp_path / "s.s2r")
    with s2rstore.open(path) as store:
        harm = store.heatmaps(RUN, "harm", "real", 0, len(store.instances), "position")
        iid = int(np.abs(harm).sum(axis=(1, 2)).argmax())
        segments, _ = ndimage.label(harm[iid] != 0, np.ones((3, 3)))
        numbers = range(1, segments.max() + 1)
        largest = max(numbers, key=lambda number: abs(harm[iid][segments == number].sum()))
        pixels = (segments == largest)[::2, ::2]  # the network doubles the images
        before, after = (
            restored_error(store, iid, pixels & False),
            restored_error(store, iid, pixels),
        )
        assert before == pytest.approx(store.run_columns(RUN).real.error[iid], abs=1e-2)
    image = np.where(pixels, 999, 0).astype(np.uint16)
    source = LabelSource({999: "box"}, frozenset({iid}), lambda _: image)
    write_labels(path, "real", lambda store: source, "test")
    with s2rstore.open(path) as store:
        gain = store.run_columns(RUN).label_gains("box")
        assert np.flatnonzero(np.isfinite(gain)).tolist() == [iid]
        assert abs(gain[iid]) > 0.1
        assert gain[iid] == pytest.approx(before - after, abs=0.05)


SHOWN = np.kron(np.array([[0, 1], [300, 1]]), np.ones((16, 16))).astype(np.uint16)
"""A label image of twice the size of the frames."""


def png_folder(root: Path) -> tuple[str, ...]:
    """Label images of instances 3 and 30, named by their source images."""
    (root / "masks").mkdir(parents=True)
    for name in ("0003.png", "0030.png"):
        cv2.imwrite(str(root / "masks" / name), SHOWN)
    (root / "classes.csv").write_text("id,name\n1,chair\n300,fire door\n3,lamp\n2,chair\n")
    return str(root / "masks"), "--classes", str(root / "classes.csv")


def scannet_folder(root: Path) -> tuple[str, ...]:
    """The same with ScanNet's table of labels."""
    folder, option, classes = png_folder(root)
    rows = [line.split(",") for line in Path(classes).read_text().splitlines()[1:]]
    lines = ["id\traw_category\tcount", *(f"{number}\t{name}\t1" for number, name in rows)]
    (root / "labels.tsv").write_text("\n".join(lines))
    return folder, option, str(root / "labels.tsv")


def coco_file(root: Path) -> tuple[str, ...]:
    """The same as a COCO file: a polygon that another one covers in part, and run lengths."""
    root.mkdir()
    right = [16, 0, 31, 0, 31, 31, 16, 31]
    masks = [
        (1, [[0, 16, 31, 16, 31, 31, 0, 31], right]),
        (300, {"size": [32, 32], "counts": [x for _ in range(16) for x in (16, 16)] + [512]}),
    ]
    content = {
        "categories": [{"id": 1, "name": "chair"}, {"id": 2, "name": "chair"},
                       {"id": 3, "name": "lamp"}, {"id": 300, "name": "fire door"}],
        "images": [{"id": n, "file_name": f"{n:04d}.jpg", "height": 32, "width": 32}
                   for n in (3, 30)],
        "annotations": [{"image_id": n, "category_id": label, "segmentation": mask}
                        for n in (3, 30) for label, mask in masks],
    }  # fmt: skip
    (root / "labels.json").write_text(json.dumps(content))
    return (str(root / "labels.json"),)


@pytest.mark.parametrize("write", [png_folder, scannet_folder, coco_file])
def test_imported_labels_are_stored_and_select(s2r, store_copy, tmp_path, write):
    for place in ("first", "second"):  # the second import replaces the first one
        source = write(tmp_path / place)
        assert (
            "2 label images of real, 2 labels" in s2r("labels", "import", store_copy, *source).out
        )
    with s2rstore.open(store_copy) as store:
        images = store.label_images("real", 0, len(store.instances))
        assert (images[[3, 30]] == SHOWN[::2, ::2]).all()
        assert np.flatnonzero(images.any(axis=(1, 2))).tolist() == [3, 30]
        for expression, iids in (
            ("label:chair", [3, 30]), ('label:"fire door" - traj:a', [30]), ("label:lamp", []),
        ):  # fmt: skip
            query, parameters = evaluation.sql(store, expression)
            assert [iid for (iid,) in store.execute(query, parameters)] == iids
            assert np.flatnonzero(evaluation.select(store, expression)).tolist() == iids
    assert s2r("query", store_copy, "ids(3)", "--columns", "label", "--json").json == [
        {"label": "chair fire door"}
    ]


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('"images": [', '"images": [], "more": [', "images: expected a list of length >= 1"),
        ('"height": 32', '"height": -3', "height: expected a whole number >= 1, got -3"),
        ('"height": 32', '"height": Infinity', "height: expected a whole number"),
        ('"image_id": 30', '"image_id": 31', "an annotation is of image 31, which is not listed"),
        ('"file_name": "0030.jpg"', '"file_name": "0003.jpg"', "file_name '0003.jpg' stands twice"),
        ('"id": 2,', '"id": 1,', "id of a category 1 stands twice"),
        ("[16, 0,", "[NaN, 0,", "a segmentation of 0003.jpg is invalid"),
        ("[16, 16,", "[-1e30, 16,", "a segmentation of 0003.jpg is invalid"),
    ],
)  # fmt: skip
def test_damaged_coco_files_are_refused(s2r, store_copy, tmp_path, old, new, text):
    (path,) = coco_file(tmp_path / "labels")
    content = Path(path).read_text()
    assert old in content
    Path(path).write_text(content.replace(old, new, 1))
    done = s2r("labels", "import", store_copy, path)
    assert done.code == 2
    assert text in done.err


def test_replaced_label_images_are_pruned_and_damage_is_found(s2r, store_copy, tmp_path):
    source = png_folder(tmp_path / "labels")
    s2r("labels", "import", store_copy, *source).checked()
    (old,) = store_copy.glob("frames.zarr/real/a/labels-*")
    cv2.imwrite(str(tmp_path / "labels/masks/0003.png"), np.zeros_like(SHOWN))
    s2r("labels", "import", store_copy, *source).checked()
    assert old.is_dir()
    prune(store_copy, keep=1)
    (new,) = store_copy.glob("frames.zarr/real/a/labels-*")
    assert new != old
    assert not check(store_copy).damages
    shard = next(each for each in new.iterdir() if each.name.startswith("c."))
    shard.write_bytes(shard.read_bytes()[:-1])
    (damage,) = check(store_copy).damages
    assert str(shard.relative_to(store_copy)) == damage.where


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [("0003.png", 9, "1 value not in"), ("other.png", 1, "other.png belongs to no frame of real"),
     ("7.png", 1, "7.png belongs to no frame of real")],
)  # fmt: skip
def test_label_images_that_cannot_be_used_are_refused(
    s2r, store_copy, tmp_path, name, value, text
):  # fmt: skip
    folder, *classes = png_folder(tmp_path / "labels")
    cv2.imwrite(f"{folder}/{name}", np.full_like(SHOWN, value))
    result = s2r("labels", "import", store_copy, folder, *classes).checked(2)
    assert text in result.err
    assert result.err.count("\n") == 1


def test_a_pixel_counts_for_the_objects_of_both_scenes_once():
    """Label 1 is in both scenes, 2 in reality alone, 3 in simulation alone."""
    harm = np.array([[1.0, -0.5], [0.25, np.nan]])
    real = np.kron([[1, 2], [0, 0]], np.ones((2, 2))).astype(int)
    sim = np.kron([[1, 3], [3, 0]], np.ones((2, 2))).astype(int)
    gains = image_gains(harm, real, sim)
    assert np.allclose(gains, [np.nan, 1.0, -0.5, -0.25], equal_nan=True)


def test_the_table_ranks_classes_by_their_mean_gain(s2r, tiny_store):
    found = s2r("objects", tiny_store, "--select", "traj:a", "--json").json
    assert [row["object"] for row in found["objects"]] == ["fire door", "chair"]
    with s2rstore.open(tiny_store) as store:
        of_a = store.instances.trajectory == 0
        for row in found["objects"]:
            gain = store.run_columns(RUN).label_gains(row["object"])[of_a]
            assert row["gain_m"] == pytest.approx(np.nanmean(gain))
            assert row["images"] == np.isfinite(gain).sum()
            assert row["harmed"] == (gain > 0.25).sum()
            expression = f"traj:a & {row['expression']}"
            assert s2r("query", tiny_store, expression, "--count").out == f"{row['images']}\n"
    lines = s2r("objects", tiny_store).lines
    assert lines[1].split()[:2] == ["fire", "door"]


def test_a_run_without_gains_says_what_computes_them(s2r, computed_store):
    assert "`s2r labels import` adds them" in s2r("objects", computed_store).checked(2).err


async def test_the_chosen_class_is_marked_on_images_and_map(objects_world):
    async with running(objects_world, size=(200, 60)) as (app, pilot):
        await press(app, pilot, "c", "colon", "down", "enter")
        label = app.session.state.chosen_row("objects")
        assert label in app.session.state.expression
        shown = app.loaded.pictures
        store = app.session.store
        values = [value for value, name in store.label_names.items() if name == label]
        for role, side in shown.sides:
            found = np.isin(store.label_images(role, shown.iid, shown.iid + 1)[0], values)
            assert found.any() == (side.marked is not None)
            assert side.marked is None or np.array_equal(side.marked, found)
        place = next(side.place for _, side in shown.sides if side.place is not None)
        truth = store.instances
        away = np.array(place) - (truth.x[shown.iid], truth.y[shown.iid])
        heading = truth.heading[shown.iid]
        assert away @ (np.cos(heading), np.sin(heading)) > 0  # the object is in front of the camera
        assert len(MAP.input(app.updater.scene).objects) > 0
        await press(app, pilot, "escape")
        assert MAP.input(app.updater.scene).objects == ()
        assert all(side.marked is None for _, side in app.loaded.pictures.sides)
