"""Scores on worlds with simple ground truth: only object changes, or only other factors."""

import json
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.findings import store_summary
from s2rstore.index.transaction import edit
from s2rstore.metrics import run_metrics
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.scoring import report
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.heatmap_metrics import floor_truth
from s2rtools.training import pretrained
from s2rtui.cli import main
from tests.conftest import BuildOnce
from tests.support.copies import copy_store
from tests.support.silent_reporter import SilentReporter

KINDS = ("pixel_difference", "harmonised_difference", "harmonised_distance")


def make(path: Path, factors: str, count: int, kinds: tuple[str, ...]) -> None:
    arguments = ["ingest", "world", "--instances", str(count), "--size", "64", "--factors", factors]
    assert main([*arguments, "--store", str(path)]) == 0
    pretrained.add_pretrained_models(path)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(kinds))


@pytest.fixture(scope="module")
def objects_only(build_once: BuildOnce) -> Path:
    return build_once("objects.s2r", lambda path: make(path, "objects", 6, KINDS))


@pytest.fixture(scope="module")
def light_only(build_once: BuildOnce) -> Path:
    return build_once("light.s2r", lambda path: make(path, "lights,exposure=0.5", 2, KINDS[:1]))


@pytest.fixture(scope="module")
def objects_scored(objects_only: Path) -> report.ScoreReport:
    return report.score(objects_only, report.ScoreSettings(("vanilla",)), SilentReporter())


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
def test_equal_seeds_give_equal_text(objects_only, objects_scored):
    repeated, other = (
        report.score(objects_only, report.ScoreSettings(("vanilla",), seed=seed), SilentReporter())
        for seed in (1, 5)
    )
    assert json.dumps(repeated, sort_keys=True) == json.dumps(objects_scored, sort_keys=True)
    assert other["heatmaps"] != repeated["heatmaps"]


def test_a_score_is_saved_once_and_summarized(objects_only, objects_scored, tmp_path):
    path = copy_store(objects_only, tmp_path / "own.s2r")
    assert report.save_report(path, objects_scored)
    assert not report.save_report(path, objects_scored)
    with s2rstore.open(path) as store:
        summary = "\n".join(store_summary.summary_lines(store))
    assert "costliest factor of vanilla: objects" in summary
    assert "best heatmap of vanilla: harmonised" in summary


def test_provenance_of_a_kind_is_kept_when_others_are_added(objects_only, tmp_path):
    store_path = copy_store(objects_only, tmp_path / "own.s2r")
    precompute(store_path, SilentReporter(), ["vanilla"], PrecomputeOptions(("feature_distance",)))
    with s2rstore.open(objects_only) as before, s2rstore.open(store_path) as after:
        old, new = (store.provenance("run:vanilla") for store in (before, after))
    assert json.loads(new["surfaces"]) == json.loads(old["surfaces"])
    ranges = json.loads(new["heat ranges"])
    assert set(ranges) == {*json.loads(old["heat ranges"]), "feature_distance"}


def test_positive_floor_cells_are_near_changed_objects(objects_only):
    with s2rstore.open(objects_only) as store:
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
