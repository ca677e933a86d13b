"""Runs whose cameras are moved: their frames, their rigs and everything that is made of them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.geometry.camera import rays, to_floor
from s2rstore.geometry.camera_offset import CameraMove
from s2rstore.index.transaction import edit
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from s2rstore.reader import Store
from s2rstore.records import Domain
from s2rstore.run_inputs import run_domain, run_frame, run_frames
from s2rtools.adjustments import apply_chain, parse_adjustment
from s2rtools.inference import open_backend
from s2rtools.models.library import load_model
from s2rtools.models.preprocessing import preprocess
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.registration import add_run
from s2rtools.rendering import no_renderer_reason, open_renderer
from s2rtools.scoring.factor_effects import Counterfactuals
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtui.session.heatmaps import heatmap_choices, instance_grid
from s2rtui.session.state import HeatChoice
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

pytestmark = pytest.mark.xdist_group("world")


@pytest.fixture(scope="module")
def store(moved_camera_store: Path) -> Store:
    return s2rstore.open(moved_camera_store)


def array(store: Store, run: str, *names: str | None) -> np.ndarray:
    return np.asarray(store.array(run, *names)[1][:])


def test_zero_everywhere_gives_the_very_same_bytes(store: Store) -> None:
    assert store.run("zero").sim_adjustments != []
    for record in store.arrays("zero"):
        names = record.kind, record.side, record.mode
        assert array(store, "zero", *names).tobytes() == array(store, "vanilla", *names).tobytes()
    for side in ("sim", "real"):
        run = store.run("zero")
        assert run_domain(store, run, side) is store.domains[side]
        assert (run_frame(store, run, side, 3).rgb == store.frame(3, side).rgb).all()


def test_only_the_moved_side_has_frames_of_its_own(store: Store, moved_camera_store: Path) -> None:
    kept = {
        run: sorted((r.kind, r.side) for r in store.arrays(run) if r.kind.startswith("frames:"))
        for run in ("vanilla", "zero", "up", "low")
    }
    assert kept["vanilla"] == kept["zero"] == []
    assert kept["up"] == [("frames:depth", "sim"), ("frames:rgb", "sim")]
    assert kept["low"] == [("frames:depth", "real"), ("frames:rgb", "real")]
    assert (array(store, "up", "prediction", "real")
            == array(store, "vanilla", "prediction", "real")).all()  # fmt: skip
    assert (array(store, "up", "prediction", "sim")
            != array(store, "vanilla", "prediction", "sim")).any()  # fmt: skip
    assert "frames:rgb" not in {kind for kind, _ in heatmap_choices(store, "up")}
    assert verify(moved_camera_store) == []


def floor_heights(depth: np.ndarray, domain: Domain) -> np.ndarray:
    """Heights of what the lowest rows of one view show: the floor, where nothing stands there."""
    size = depth.shape[0]
    beams = rays(domain.depth, np.arange(size) + 0.5, np.arange(size) + 0.5)
    metres = depth[None] * np.float64(domain.depth_scale)
    height = to_floor(beams, metres, domain, np.zeros((1, 3)), True)[2][0, -12:]
    return height[depth[-12:] > 0]


def test_depth_lies_on_the_floor_through_the_moved_rig_alone(store: Store) -> None:
    run = store.run("up")
    moved, declared = run_domain(store, run, "sim"), store.domains["sim"]
    assert moved.camera_height == pytest.approx(declared.camera_height + 0.1)
    right, wrong = [], []
    for iid in range(len(store.instances)):
        depth = run_frame(store, run, "sim", iid).depth
        right.append(np.median(np.abs(floor_heights(depth, moved))))
        wrong.append(np.median(np.abs(floor_heights(depth, declared))))
    assert np.median(right) < 0.01
    assert np.median(wrong) > 0.03


@pytest.mark.parametrize("side", ["sim", "real"])
def test_a_hair_of_a_move_renders_what_is_stored(store: Store, side: str) -> None:
    """Poses and the noise of each view are those of its instance."""
    n = len(store.instances)
    rgb, depth = open_renderer(store, side).frames(side, 0, n, CameraMove(height=1e-7))
    held = store.frames(side, 0, n)
    away = np.abs(rgb.astype(np.float32) - held["rgb"]) > 3
    far = np.abs(depth.astype(np.float32) - held["depth"]) > 20
    assert away.mean(axis=(1, 2, 3)).max() < 0.01
    assert far.mean(axis=(1, 2)).max() < 0.01


def test_predictions_are_of_the_rendered_and_adjusted_images(store: Store) -> None:
    run, model = store.run("up"), load_model(store, "vanilla")
    images = run_frames(store, run, "sim", 2, 5)
    rgb, depth = apply_chain(
        images["rgb"],
        images["depth"],
        images["depth"] > 0,
        parse_adjustment("sim:brightness=1.2")["sim"],
    )
    x = preprocess(rgb, depth, 0.001, (128, 128))
    with torch.inference_mode():
        poses = model.convention.decode(model.network(torch.from_numpy(x))).numpy()
    found = array(store, "up", "prediction", "sim")[2:5]
    np.testing.assert_allclose(found[:, :2], poses[:, :2], atol=1e-3)


def test_one_frame_is_a_row_of_many(store: Store) -> None:
    run = store.run("low")
    many = run_frames(store, run, "real", 1, 4)
    one = run_frame(store, run, "real", 2)
    assert (one.rgb == many["rgb"][1]).all()
    assert (one.depth == many["depth"][1]).all()
    assert (one.valid == (one.depth > 0)).all()
    with pytest.raises(RequestError, match=r"instance 99: the store holds 0 \.\. 7"):
        run_frame(store, run, "real", 99)


@pytest.mark.parametrize("kind", ["feature_distance", "harmonised_distance"])
@pytest.mark.parametrize(("run", "side"), [("up", "sim"), ("up", "real"), ("low", "real")])
def test_the_application_projects_like_the_precompute(
    store: Store, run: str, side: str, kind: str
) -> None:
    whole = store.map_grid(run, kind, side, None, "count")
    total = np.zeros_like(whole)
    for iid in range(len(store.instances)):
        total += np.isfinite(instance_grid(store, run, HeatChoice(kind, None, side), iid))
    assert ((total > 0) == (whole > 0)).all()
    plain = store.map_grid("vanilla", kind, side, None, "count")
    own_rig_is_moved = (run, side) != ("up", "real")
    assert ((plain > 0) != (whole > 0)).any() == (own_rig_is_moved or kind != "feature_distance")


def test_the_counterfactual_with_all_factors_is_the_stored_error(store: Store) -> None:
    """The real side through each run's own camera."""
    judges = [
        (store.run(name), open_backend(load_model(store, "vanilla"), "torch"))
        for name in ("vanilla", "low")
    ]
    truth = GroundTruth(store)
    table = Counterfactuals(truth, judges, 8)
    errors = table.errors({"real": table.active})["real"]
    for name in ("vanilla", "low"):
        stored = store.run_columns(name).real.error[table.iids]
        assert np.allclose(errors[name], stored, atol=1e-4)
    moves = truth.camera_moves("low")
    assert truth.visible_objects("sim", moves["sim"]) is truth.visible_objects("sim")
    assert (
        truth.visible_objects("real", moves["real"]).samples
        != truth.visible_objects("real").samples
    ).any()


def test_moved_cameras_need_a_renderer(tiny_store: Path, store_copy: Path) -> None:
    with s2rstore.open(tiny_store) as opened:
        assert "not rendered" in str(no_renderer_reason(opened))
        with pytest.raises(RequestError, match="taken, not rendered"):
            open_renderer(opened, "sim")
    with pytest.raises(RequestError, match="taken, not rendered"):
        add_run(store_copy, "up", "vanilla", None, None, parse_adjustment("sim:camera_height=0.1"))
    add_run(store_copy, "same", "vanilla", None, None, parse_adjustment("sim:camera_height=0"))


def test_a_world_that_is_rendered_otherwise_is_refused(
    moved_camera_store: Path, tmp_path: Path
) -> None:
    path = copy_store(moved_camera_store, tmp_path / "other.s2r")
    with s2rstore.open(path) as opened:
        assert no_renderer_reason(opened) is None
        recipe = json.loads(opened.provenance("world")["recipe"])
    with edit(path) as draft:
        draft.set_provenance("world", {"recipe": recipe | {"seed": 3}})
    with pytest.raises(RequestError, match="its images are not what this version renders"):
        add_run(path, "more", "vanilla", None, None, parse_adjustment("sim:camera_height=0.1"))
    twice = parse_adjustment("sim:camera_height=-0.4,camera_height=-0.3")
    with pytest.raises(RequestError, match="camera_height twice"):
        add_run(path, "sunk", "vanilla", None, None, twice)


def test_frames_are_neither_pruned_nor_made_again(moved_camera_store: Path, tmp_path: Path) -> None:
    path = copy_store(moved_camera_store, tmp_path / "pruned.s2r")
    prune(path, keep=1)
    assert verify(path) == []
    told = SilentReporter()
    kinds = ("feature_distance", "pixel_difference", "harmonised_distance")
    assert precompute(path, told, ["up"], PrecomputeOptions(kinds)) == []
    assert told.lines == ["up: up to date"]


def test_frames_that_are_not_computed_yet_say_so(moved_camera_store: Path, tmp_path: Path) -> None:
    path = copy_store(moved_camera_store, tmp_path / "later.s2r")
    add_run(path, "later", "vanilla", None, None, parse_adjustment("sim:camera_pitch=3"))
    with s2rstore.open(path) as opened, pytest.raises(RequestError, match="s2r precompute"):
        run_frame(opened, opened.run("later"), "sim", 0)
