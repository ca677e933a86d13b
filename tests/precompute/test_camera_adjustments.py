"""Runs with moved cameras: their frames, rigs and derived results."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.geometry.camera import rays, to_floor
from s2rstore.geometry.camera_offset import RenderChange
from s2rstore.index.transaction import edit
from s2rstore.maintenance.prune import prune
from s2rstore.maintenance.verify import verify
from s2rstore.reader import Store
from s2rstore.records import Domain
from s2rstore.run_inputs import run_domain, run_frame, run_frames
from s2rtools.adjustments import apply_chain, parse_adjustment
from s2rtools.inference import open_backend
from s2rtools.models.input_contract import InputContract
from s2rtools.models.load_model import load_model
from s2rtools.models.preprocessing import preprocess
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.precompute.run_registration import add_run
from s2rtools.scoring.factor_effects import Counterfactuals
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.synthetic_world.stored_world import no_renderer_reason, open_renderer
from s2rtui.session.heatmaps import heatmap_choices, instance_grid
from s2rtui.session.state import HeatChoice
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter


@pytest.fixture(scope="module")
def store(moved_camera_store: Path) -> Store:
    return s2rstore.open(moved_camera_store)


def array(store: Store, run: str, *names: str | None) -> np.ndarray:
    return np.asarray(store.array(run, *names)[1][:])


def test_zero_adjustments_give_identical_results(store):
    assert store.run("zero").sim_adjustments != []
    for record in store.array_kinds("zero"):
        names = record.kind, record.side, record.mode
        assert array(store, "zero", *names).tobytes() == array(store, "vanilla", *names).tobytes()
    for side in ("sim", "real"):
        run = store.run("zero")
        assert run_domain(store, run, side) is store.domains[side]
        assert (run_frame(store, run, side, 3).rgb == store.frame(side, 3).rgb).all()


def test_only_the_moved_side_has_rendered_frames(store, moved_camera_store):
    frame_arrays = {
        run: sorted(
            (r.kind, r.side) for r in store.array_kinds(run) if r.kind.startswith("frames:")
        )
        for run in ("vanilla", "zero", "up", "low")
    }
    assert frame_arrays["vanilla"] == frame_arrays["zero"] == []
    assert frame_arrays["up"] == [("frames:depth", "sim"), ("frames:rgb", "sim")]
    assert frame_arrays["low"] == [("frames:depth", "real"), ("frames:rgb", "real")]
    assert (array(store, "up", "prediction", "real")
            == array(store, "vanilla", "prediction", "real")).all()  # fmt: skip
    assert (array(store, "up", "prediction", "sim")
            != array(store, "vanilla", "prediction", "sim")).any()  # fmt: skip
    assert "frames:rgb" not in {kind for kind, _ in heatmap_choices(store, "up")}
    assert verify(moved_camera_store) == []


def floor_heights(depth: np.ndarray, domain: Domain) -> np.ndarray:
    """Heights of the points in the lowest rows of a view; unobstructed, they are on the floor."""
    size = depth.shape[0]
    beams = rays(domain.depth, np.arange(size) + 0.5, np.arange(size) + 0.5)
    metres = depth[None] * np.float64(domain.depth_scale)
    height = to_floor(beams, metres, domain, np.zeros((1, 3)), True)[2][0, -12:]
    return height[depth[-12:] > 0]


def test_depth_matches_the_floor_only_with_the_moved_rig(store):
    run = store.run("up")
    moved, declared = run_domain(store, run, "sim"), store.domains["sim"]
    assert moved.camera_height == pytest.approx(declared.camera_height + 0.1)
    moved_rig_errors, declared_rig_errors = [], []
    for iid in range(len(store.instances)):
        depth = run_frame(store, run, "sim", iid).depth
        moved_rig_errors.append(np.median(np.abs(floor_heights(depth, moved))))
        declared_rig_errors.append(np.median(np.abs(floor_heights(depth, declared))))
    assert np.median(moved_rig_errors) < 0.01
    assert np.median(declared_rig_errors) > 0.03


@pytest.mark.parametrize("side", ["sim", "real"])
def test_a_tiny_move_renders_the_stored_frames(store, side):
    """Poses and noise of each view are those of its instance."""
    n = len(store.instances)
    rgb, depth = open_renderer(store, side).frames(side, 0, n, RenderChange(height=1e-7))
    stored = store.frames(side, 0, n)
    differs_rgb = np.abs(rgb.astype(np.float32) - stored["rgb"]) > 3
    differs_depth = np.abs(depth.astype(np.float32) - stored["depth"]) > 20
    assert differs_rgb.mean(axis=(1, 2, 3)).max() < 0.01
    assert differs_depth.mean(axis=(1, 2)).max() < 0.01


def test_predictions_use_the_rendered_and_adjusted_images(store):
    run, model = store.run("up"), load_model(store, "vanilla")
    images = run_frames(store, run, "sim", 2, 5)
    rgb, depth = apply_chain(
        images["rgb"],
        images["depth"],
        images["depth"] > 0,
        parse_adjustment("sim:brightness=1.2")["sim"],
    )
    x = preprocess(rgb, depth, 0.001, InputContract(size=(128, 128)))
    with torch.inference_mode():
        poses = model.convention.decode(model.network(torch.from_numpy(x))).numpy()
    predictions = array(store, "up", "prediction", "sim")[2:5]
    np.testing.assert_allclose(predictions[:, :2], poses[:, :2], atol=1e-3)


def test_a_single_frame_equals_a_row_of_a_batch(store):
    run = store.run("low")
    batch = run_frames(store, run, "real", 1, 4)
    single = run_frame(store, run, "real", 2)
    assert (single.rgb == batch["rgb"][1]).all()
    assert (single.depth == batch["depth"][1]).all()
    assert (single.valid == (single.depth > 0)).all()
    with pytest.raises(RequestError, match=r"instance 99: the store holds 0 \.\. 7"):
        run_frame(store, run, "real", 99)


@pytest.mark.parametrize("kind", ["feature_distance", "harmonised_distance"])
@pytest.mark.parametrize(("run", "side"), [("up", "sim"), ("up", "real"), ("low", "real")])
def test_the_application_projects_heatmaps_like_precompute(store, run, side, kind):
    stored_grid = store.map_grid(run, kind, side, None, "count")
    total = np.zeros_like(stored_grid)
    for iid in range(len(store.instances)):
        total += np.isfinite(instance_grid(store, run, HeatChoice(kind, None, side), iid))
    assert ((total > 0) == (stored_grid > 0)).all()
    unadjusted_grid = store.map_grid("vanilla", kind, side, None, "count")
    rig_is_moved = (run, side) != ("up", "real")
    assert ((unadjusted_grid > 0) != (stored_grid > 0)).any() == (
        rig_is_moved or kind != "feature_distance"
    )


def test_the_counterfactual_with_all_factors_equals_the_stored_error(store):
    """The real side is rendered with the camera of each run."""
    backends = [
        (store.run(name), open_backend(load_model(store, "vanilla"), "torch"))
        for name in ("vanilla", "low")
    ]
    truth = GroundTruth(store)
    table = Counterfactuals(truth, backends, 8)
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


def test_moved_cameras_need_a_renderer(tiny_store, store_copy):
    with s2rstore.open(tiny_store) as opened:
        assert "not rendered" in str(no_renderer_reason(opened))
        with pytest.raises(RequestError, match="taken, not rendered"):
            open_renderer(opened, "sim")
    with pytest.raises(RequestError, match="taken, not rendered"):
        add_run(store_copy, "up", "vanilla", None, None, parse_adjustment("sim:camera_height=0.1"))
    add_run(store_copy, "same", "vanilla", None, None, parse_adjustment("sim:camera_height=0"))


def test_a_world_with_other_images_is_rejected(moved_camera_store, tmp_path):
    path = copy_store(moved_camera_store, tmp_path / "other.s2r")
    with s2rstore.open(path) as opened:
        assert no_renderer_reason(opened) is None
        recipe = json.loads(opened.provenance("world")["recipe"])
    with edit(path) as draft:
        draft.set_provenance("world", {"recipe": recipe | {"seed": 3}})
    with pytest.raises(RequestError, match="this version renders other images"):
        add_run(path, "more", "vanilla", None, None, parse_adjustment("sim:camera_height=0.1"))
    repeated = parse_adjustment("sim:camera_height=-0.4,camera_height=-0.3")
    with pytest.raises(RequestError, match="camera_height twice"):
        add_run(path, "sunk", "vanilla", None, None, repeated)


def test_rendered_frames_are_not_pruned_or_recomputed(moved_camera_store, tmp_path):
    path = copy_store(moved_camera_store, tmp_path / "pruned.s2r")
    prune(path, keep=1)
    assert verify(path) == []
    reporter = SilentReporter()
    kinds = ("feature_distance", "pixel_difference", "harmonised_distance")
    assert precompute(path, reporter, ["up"], PrecomputeOptions(kinds)) == []
    assert reporter.lines == ["up: up to date"]


def test_uncomputed_frames_are_an_error(moved_camera_store, tmp_path):
    path = copy_store(moved_camera_store, tmp_path / "later.s2r")
    add_run(path, "later", "vanilla", None, None, parse_adjustment("sim:camera_pitch=3"))
    with s2rstore.open(path) as opened, pytest.raises(RequestError, match="s2r precompute"):
        run_frame(opened, opened.run("later"), "sim", 0)
