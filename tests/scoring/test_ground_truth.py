"""Scores on worlds with simple ground truth, and the counterfactual errors that they rest on."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.findings import store_summary
from s2rstore.geometry.camera_offset import UNCHANGED
from s2rstore.index.transaction import edit
from s2rstore.metrics import run_metrics
from s2rtools.models.input_contract import InputContract
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.scoring import report
from s2rtools.scoring.counterfactual_errors import CounterfactualErrors, open_runs
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.heatmap_metrics import floor_truth
from s2rtools.training import pretrained
from s2rtui.cli import main
from tests.conftest import BuildOnce, make_world
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

KINDS = ("pixel_difference", "harmonised_difference", "harmonised_distance")


@pytest.fixture(scope="module")
def light_only(build_once: BuildOnce) -> Path:
    return build_once(
        "light.s2r", lambda path: make_world(path, "lights,exposure=0.5", 2, KINDS[:1])
    )


@pytest.fixture(scope="module")
def objects_scored(objects_world: Path) -> report.ScoreReport:
    return report.score(objects_world, report.ScoreSettings(("vanilla",)), SilentReporter())


@pytest.fixture(scope="module")
def light_scored(light_only: Path) -> report.ScoreReport:
    return report.score(light_only, report.ScoreSettings(("vanilla",)), SilentReporter())


def rows(scored: report.ScoreReport, **values_expected: str) -> list[dict]:
    return [row for row in scored["heatmaps"]
            if all(row[name] == value for name, value in values_expected.items())]  # fmt: skip


def test_object_changes_are_detected(objects_scored):
    """Only objects differ: every method finds them, and random scores have AUROC 0.5."""
    for kind in KINDS:
        scores = rows(objects_scored, place="floor", kind=kind, side="both")
        assert max(row["auroc"] for row in scores) > 0.88, kind
    (chance,) = rows(objects_scored, place="image", kind="random")
    assert chance["auroc"] == pytest.approx(0.5, abs=0.06)
    assert chance["precision"] == pytest.approx(chance["base_rate"], abs=0.06)
    for row in objects_scored["heatmaps"]:
        if row["auroc_low"] is not None:
            assert row["auroc_low"] - 1e-6 <= row["auroc"] <= row["auroc_high"] + 1e-6


def test_only_the_active_factor_has_a_cost(objects_scored):
    (row,) = objects_scored["factors"]
    assert row["factor"] == "objects"
    assert row["cost"] == pytest.approx(row["gain"])
    assert objects_scored["objects"]


def test_the_pretrained_models_have_the_documented_ranking(world_with_all_factors):
    """Finetuning on real images closes most of the gap; all models are accurate in simulation."""
    with s2rstore.open(world_with_all_factors) as store:
        real = {
            name: run_metrics.side_metrics(store, name, "real") for name in ("vanilla", "finetune")
        }
        sim = run_metrics.side_metrics(store, "vanilla", "sim")
    assert real["finetune"].mean_error < 0.8 * real["vanilla"].mean_error
    assert sim.mean_error < 0.4 * real["vanilla"].mean_error


def test_images_of_another_version_are_rejected(world_with_all_factors, monkeypatch):
    from s2rtools.synthetic_world.dataset import WorldData

    with s2rstore.open(world_with_all_factors) as store:
        raw_depth = WorldData.raw_depth
        monkeypatch.setattr(WorldData, "raw_depth", lambda self, views: raw_depth(self, views) // 2)
        with pytest.raises(RequestError, match="ingest the world again"):
            GroundTruth(store)


def test_pretrained_models_are_rejected_for_another_seed(light_only, tmp_path):
    path = copy_store(light_only, tmp_path / "other.s2r")
    with s2rstore.open(path) as store:
        recipe = json.loads(store.provenance("world")["recipe"])
    with edit(path) as draft:
        draft.set_provenance("world", {"recipe": recipe | {"seed": 4}})
    with pytest.raises(RequestError, match="--seed 1"):
        pretrained.add_pretrained_models(path)


def test_without_object_changes_there_are_no_positives(light_scored):
    for row in rows(light_scored, place="image"):
        assert row["auroc"] is None
        assert (row["n"], row["without"]) == (0, 4)
    for row in rows(light_scored, place="floor"):
        assert row["auroc"] is None
        assert row["base_rate"] == 0
    assert light_scored["objects"] == []
    assert {row["factor"] for row in light_scored["factors"]} == {"lights", "exposure"}
    cost = {row["factor"]: row["cost"] for row in light_scored["factors"]}
    assert cost["lights"] > 0.5


@pytest.mark.deep
def test_equal_seeds_give_equal_text(objects_world, objects_scored):
    repeated, other = (
        report.score(objects_world, report.ScoreSettings(("vanilla",), seed=seed), SilentReporter())
        for seed in (1, 5)
    )
    assert json.dumps(repeated, sort_keys=True) == json.dumps(objects_scored, sort_keys=True)
    assert other["heatmaps"] != repeated["heatmaps"]


def test_a_score_is_saved_once_and_summarized(objects_world, objects_scored, tmp_path):
    path = copy_store(objects_world, tmp_path / "own.s2r")
    assert report.save_report(path, objects_scored)
    assert not report.save_report(path, objects_scored)
    with s2rstore.open(path) as store:
        summary = "\n".join(store_summary.summary_lines(store))
    assert "costliest factor of vanilla: objects" in summary
    assert "best heatmap of vanilla: harmonised" in summary


def test_provenance_of_a_kind_is_kept_when_others_are_added(objects_world, tmp_path):
    store_path = copy_store(objects_world, tmp_path / "own.s2r")
    precompute(store_path, SilentReporter(), ["vanilla"], PrecomputeOptions(("feature_distance",)))
    with s2rstore.open(objects_world) as before, s2rstore.open(store_path) as after:
        old, new = (store.provenance("run:vanilla") for store in (before, after))
    assert json.loads(new["surfaces"]) == json.loads(old["surfaces"])
    ranges = json.loads(new["heat ranges"])
    assert set(ranges) == {*json.loads(old["heat ranges"]), "feature_distance"}


def test_positive_floor_cells_are_near_changed_objects(objects_world):
    with s2rstore.open(objects_world) as store:
        truth = GroundTruth(store)
        positive, is_visible = floor_truth(truth, "both")
        cell = store.dataset.bounds.width / positive.shape[1]
        object_positions = [
            (part.x, part.y, max(part.half_x, part.half_y))
            for number, item in enumerate(truth.data.world.objects, 1) if number in truth.changed
            for part in (*item.sim, *item.real)
        ]  # fmt: skip
        assert is_visible.sum() > positive.sum() > 0
        for row, col in np.argwhere(positive):
            x, y = (col + 0.5) * cell, (row + 0.5) * cell
            assert min(np.hypot(x - a, y - b) - r for a, b, r in object_positions) < 0.6


def test_a_store_without_ground_truth_is_rejected(tiny_store):
    with (
        s2rstore.open(tiny_store) as store,
        pytest.raises(RequestError, match="ground truth is unknown"),
    ):
        GroundTruth(store)


@pytest.mark.deep
def test_counterfactuals_use_the_constants_of_the_store(tmp_path):
    """Rendered again with all factors, the errors are the stored ones; the world is found again."""
    path = tmp_path / "other.s2r"
    constants = "exposure.vignette=0.5,depth.farthest=4,sensor.noise=9,camera.height=-0.05"
    factors = "lights,exposure,sensor,depth,camera"
    arguments = ["ingest", "world", "--instances", "2", "--size", "64", "--factors", factors]
    assert main([*arguments, "--constants", constants, "--store", str(path)]) == 0
    pretrained.add_pretrained_models(path)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(()))
    with s2rstore.open(path) as store:
        truth = GroundTruth(store)
        errors = CounterfactualErrors(truth, open_runs(store, ["vanilla"]))
        iids = np.arange(len(store.instances))
        found = errors.of_instances(iids, {"none": {}, "all": errors.active})
        for label, side in (("none", "sim"), ("all", "real")):
            stored = store.run_columns("vanilla").side(side).error
            assert np.allclose(found[label]["vanilla"], stored, atol=1e-4)
        assert store.frames("real", 0, 4)["depth"].max() < 4800
    assert_scored_without_objects(path)


def assert_scored_without_objects(path: Path) -> None:
    """Where no object was changed there are no pairs, and the objects have no share."""
    settings = report.ScoreSettings(("vanilla",), instances=2, harm=True, views=4)
    harm = report.score(path, settings, SilentReporter())["harm"]
    assert {(row["n"], row["auroc"]) for row in harm["kinds"]} == {(0, None)}
    assert harm["repairs"] == []
    means = {row["group"]: row["mean"] for row in harm["shares"]}
    assert means["objects"] == 0 != means["lighting"]


def test_unknown_constants_are_refused(tmp_path, s2r):
    arguments = ["ingest", "world", "--constants", "depth.range=3"]
    s2r(*arguments, "--store", tmp_path / "no.s2r").assert_refused("depth.farthest")


def test_depth_holes_of_a_run_are_missing_depth_in_its_counterfactual_views():
    metres = np.linspace(1, 5, 24, dtype=np.float32) * np.ones((1, 24, 24), dtype=np.float32)
    views = SimpleNamespace(rgb=np.zeros((1, 24, 24, 3), np.uint8), depth=metres)
    data = SimpleNamespace(
        severities=lambda side: {},
        camera=lambda side: SimpleNamespace(moved=lambda *move: None),
        sensed=lambda views, factors, numbers: views,
        raw_depth=lambda views: (1000 * views.depth).astype(np.uint16),
    )
    domain = SimpleNamespace(depth_raw_min=1, depth_raw_max=60000, depth_scale=0.001)
    truth = SimpleNamespace(
        data=data,
        camera_moves=lambda run: {"real": UNCHANGED},
        store=SimpleNamespace(domain=lambda name: domain, path=Path()),
    )
    run = SimpleNamespace(
        run="mine", real_domain="real", real_adjustments=[{"name": "depth_holes", "value": 0.2}]
    )
    inputs = []

    def forward_all(x: np.ndarray) -> SimpleNamespace:
        inputs.append(x)
        return SimpleNamespace(pose=np.zeros((len(x), 3)))

    contract = InputContract(
        "depth", (24, 24), depth_unit=1.0, depth_mean=0.0, depth_std=1.0, missing_depth=9.0
    )
    model = SimpleNamespace(contract=contract)
    network = SimpleNamespace(batch=8, model=model, forward_all=forward_all)
    errors = CounterfactualErrors(truth, [(run, network)])
    renderer = SimpleNamespace(render=lambda poses, camera: views)
    errors.of_views(renderer, np.zeros((1, 3)), np.zeros(1, dtype=np.intp))
    lost = inputs[0] == 9.0
    assert 0.1 < lost.mean() < 0.3
    assert not (inputs[0] == 0).any()
