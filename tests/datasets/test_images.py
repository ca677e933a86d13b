"""Images without poses: ingest, reading, queries and verification."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.language import evaluation
from s2rstore.maintenance.verify import verify
from s2rstore.records import NO_RUN
from s2rtools.datasets.writing.image_instances import ImageInstance, build_from_images
from s2rtools.translation import image_set
from tests.datasets.helpers import kinds
from tests.support import image_folders
from tests.support.copies import copy_store
from tests.support.hostile import edit
from tests.support.image_folders import REAL_SIZE, SIM_SIZE, folders, ingest, picture, write

FRAME = (32, 64)


@pytest.fixture(scope="module")
def store_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of images that no test modifies."""
    return image_folders.image_store(tmp_path_factory.mktemp("images"))


@pytest.fixture
def copied(store_path: Path, tmp_path: Path) -> Path:
    return copy_store(store_path, tmp_path / "copy.s2r")


def expected(number: int, size: tuple[int, int]) -> np.ndarray:
    return cv2.resize(picture(number, size), FRAME[::-1], interpolation=cv2.INTER_AREA)


def test_images_become_instances_without_poses_and_map(store_path):
    with s2rstore.open(store_path) as store:
        counts = {each.trajectory: each.instances for each in store.trajectories}
        assert counts == {"real_day": 4, "real_night": 3, "sim_city": 2, "sim_loop": 5}
        assert {name: domain.kind for name, domain in store.domains.items()} == {
            "real": "real", "sim": "sim",
        }  # fmt: skip
        dataset, domain = store.dataset, store.domain("real")
        assert not dataset.has_poses
        assert np.isnan([dataset.bounds.x0, dataset.bounds.y1, dataset.accuracy_scale]).all()
        assert dataset.floor_plan is None
        assert np.isnan([domain.rgb.fx, domain.camera_height, domain.depth_scale]).all()
        for name in ("x", "y", "heading", "curvature", "timestamp"):
            assert np.isnan(getattr(store.instances, name)).all()
        stored = store.execute("SELECT count(*) FROM instance WHERE x IS NULL AND heading IS NULL")
        assert stored == [(14,)]
        assert store.imaged("real").tolist() == [True] * 7 + [False] * 7
        assert store.imaged("sim").tolist() == [False] * 7 + [True] * 7
        with pytest.raises(RequestError, match=r"real has no images of trajectory sim_city"):
            store.frames("real", 6, 8)
        assert store.execute("SELECT rgb_path FROM frame WHERE iid = 0") == [
            ("real/images/day_3.png",)
        ]
        assert not store.runs
        assert store.run_name() == NO_RUN
        for run in (None, "vanilla"):
            with pytest.raises(RequestError, match="the data set has no poses; a run needs poses"):
                store.run(run)


def test_frames_are_averaged_over_areas_to_one_size_in_the_order_of_the_index(store_path):
    with s2rstore.open(store_path) as store:
        assert (store.dataset.frame_height, store.dataset.frame_width) == FRAME
        night, loop = (store.iids_of(name)[0] for name in ("real_night", "sim_loop"))
        real = store.frames("real", night, night + 3, ("rgb",))["rgb"]
        sim = store.frames("sim", loop, loop + 5, ("rgb",))["rgb"]
    assert np.array_equal(real, [expected(100 + n, REAL_SIZE) for n in range(3)])
    assert np.array_equal(sim, [expected(n, SIM_SIZE) for n in range(5)])


def test_small_images_are_not_enlarged(tmp_path):
    ingest(folders(tmp_path), tmp_path / "s.s2r", long_edge=500)
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert (store.dataset.frame_height, store.dataset.frame_width) == REAL_SIZE


def test_an_image_of_another_aspect_ratio_is_stretched_and_reported(tmp_path):
    sources = folders(tmp_path)
    write(sources["sim"] / "loop" / "9.png", picture(9, (96, 96)))
    scan = ingest(sources, tmp_path / "s.s2r")
    assert kinds(scan) == {"other aspect ratio": 1}
    assert scan.issues[0].file == "sim/loop/9.png"
    assert scan.issues[0].detail == "96x96; stretched to 64x32"
    with pytest.raises(RequestError, match="other aspect ratio"):
        ingest(sources, tmp_path / "strict.s2r", strict=True)
    assert not (tmp_path / "strict.s2r").exists()


def test_files_of_a_folder_itself_are_a_trajectory_named_after_the_domain(tmp_path):
    sources = folders(tmp_path)
    sources["sim"] = sources["sim"] / "loop"
    ingest(sources, tmp_path / "s.s2r", trajectories=("sim", "real_day"))
    with s2rstore.open(tmp_path / "s.s2r") as store:
        assert [t.trajectory for t in store.trajectories] == ["real_day", "sim"]


def test_expressions_select_alike_in_both_back_ends(store_path):
    with s2rstore.open(store_path) as store:
        for expression, count in (
            ("all", 14), ("traj:real_night", 3), ("traj:sim_loop & seq < 2", 2),
            ("!traj:sim_city", 12), ("ids(3..5) - iid = 4", 2), ("worst15", 0),
            ("real.error > 0 | x < 3", 0), ("!straight", 14), ("near(0, 0, 5)", 0),
        ):  # fmt: skip
            chosen = np.flatnonzero(evaluation.select(store, expression)).tolist()
            query, parameters = evaluation.sql(store, expression)
            assert chosen == [iid for (iid,) in store.execute(query, parameters)]
            assert len(chosen) == count, expression


def test_image_sets_hold_the_images_of_one_domain(store_path):
    with s2rstore.open(store_path) as store:
        everything = np.arange(14)
        real = image_set.from_store(store, "real", everything, FRAME)
        some = image_set.from_store(store, "sim", np.array([13, 0, 8, 9]), FRAME)
        with pytest.raises(RequestError, match="images none of the chosen instances"):
            image_set.from_store(store, "sim", np.arange(7))
    assert real.names == tuple(f"real/{iid}" for iid in range(7))
    assert np.array_equal(real.images[4], expected(100, REAL_SIZE))
    assert len(set(real.groups.tolist())) == 2
    assert some.names == ("sim/8", "sim/9", "sim/13")
    assert np.array_equal(some.images[1], expected(0, SIM_SIZE))


def stream(count: int = 70) -> object:
    for number in range(count):
        rgb = picture(number, (40, 60))
        yield ImageInstance(
            "bag", {"camera": rgb, "mkl": 255 - rgb}, number / 10, f"image/{number}"
        )


KINDS = {"camera": "real", "mkl": "sim"}


def test_a_generator_of_images_in_two_domains_becomes_a_store(tmp_path):
    store_path = tmp_path / "new" / "bag.s2r"
    build_from_images(stream(), KINDS, store_path, "bag", "s2r ros replay", 30)
    assert not verify(store_path)
    with s2rstore.open(store_path) as store:
        assert [(t.trajectory, t.instances) for t in store.trajectories] == [("bag", 70)]
        assert store.instances.timestamp[69] == pytest.approx(6.9)
        camera = store.frames("camera", 66, 67, ("rgb",))["rgb"][0]
        translated = store.frames("mkl", 66, 67, ("rgb",))["rgb"][0]
        source = cv2.resize(picture(66, (40, 60)), (30, 20), interpolation=cv2.INTER_AREA)
        assert np.array_equal(camera, source)
        assert np.abs(translated.astype(int) - (255 - source.astype(int))).max() <= 1
        assert store.execute("SELECT DISTINCT rgb_path FROM frame WHERE iid = 5") == [("image/5",)]


def missing_domain() -> object:
    yield from stream(2)
    yield ImageInstance("bag", {"camera": picture(1, (40, 60))})


def no_image() -> object:
    yield ImageInstance("bag", {"camera": np.zeros((4, 4), dtype=np.uint8)})


def bad_name() -> object:
    yield ImageInstance("../bag", {"camera": picture(1, (40, 60))})


@pytest.mark.parametrize(
    ("instances", "reason"),
    [
        (missing_domain, "all instances need images of the same domains"),
        (no_image, "must be uint8"),
        (bad_name, "use letters, digits"),
        (lambda: iter(()), "no images; nothing was ingested"),
    ],
)
def test_an_unusable_stream_makes_no_store(tmp_path, instances, reason):
    with pytest.raises(RequestError, match=reason):
        build_from_images(instances(), KINDS, tmp_path / "s.s2r", "bag", "s2r", 30)
    assert list(tmp_path.iterdir()) == []


def damages(path: Path) -> str:
    return "; ".join(f"{damage.where}: {damage.what}" for damage in verify(path))


@pytest.mark.parametrize(
    ("statement", "what"),
    [
        ("UPDATE instance SET x = 1.0 WHERE iid = 3", "a pose in a data set without poses"),
        ("DELETE FROM frame WHERE iid = 3", "a domain images a part of them"),
        ("UPDATE frame SET iid = 99 WHERE iid = 3", "no such instance"),
        ("UPDATE frame SET domain = 'other' WHERE iid = 3", "domain without a row in domain"),
    ],
)
def test_wrong_rows_are_found(copied, statement, what):
    edit(copied, statement)
    assert what in damages(copied)


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE dataset SET bounds_x0 = 0.0",
        "UPDATE domain SET rgb_fx = 100.0",
        "UPDATE dataset SET has_poses = true",
        "INSERT INTO run (run, model, sim_domain, real_domain, sim_adjustments, real_adjustments, "
        "created_at) VALUES ('a', 'b', 'sim', 'real', '[]', '[]', 'now')",
    ],
)
def test_an_index_that_contradicts_itself_is_not_opened(copied, statement):
    edit(copied, statement)
    with pytest.raises(RequestError, match="s2r verify"):
        s2rstore.open(copied)


def test_a_data_set_with_poses_still_needs_them(tiny_store, tmp_path):
    store = copy_store(tiny_store, tmp_path / "tiny.s2r")
    edit(store, "UPDATE instance SET x = NULL WHERE iid = 3")
    assert "pose is NULL or not finite" in damages(store)
    edit(store, "UPDATE dataset SET has_poses = false")
    with pytest.raises(RequestError, match="in a data set without poses"):
        s2rstore.open(store)
