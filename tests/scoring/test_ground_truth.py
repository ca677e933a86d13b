"""Worlds whose truth is simple: with object changes only, and with other factors only."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.metrics import run_metrics, store_summary
from s2rtools.inference import open_backend
from s2rtools.models.library import load_model
from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
from s2rtools.scoring import report
from s2rtools.scoring.factor_effects import Counterfactuals
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.heatmap_metrics import floor_truth
from s2rtools.training import pretrained
from s2rtools.training.train_into_store import TrainingRequest, train_into_store
from s2rtui.cli import main
from tests.support.copies import copy_store

pytestmark = pytest.mark.xdist_group("world")

KINDS = ("pixel_difference", "harmonised_difference", "harmonised_distance")


class SilentReporter:
    def begin(self, what: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None: ...


def make(path: Path, factors: str) -> Path:
    words = ["ingest", "world", "--instances", "12", "--size", "64", "--factors", factors]
    assert main([*words, "--store", str(path)]) == 0
    pretrained.add_pretrained_models(path)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(KINDS))
    return path


@pytest.fixture(scope="module")
def objects_only(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("world") / "objects.s2r", "objects")


@pytest.fixture(scope="module")
def light_only(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make(tmp_path_factory.mktemp("world") / "light.s2r", "lights,exposure=0.5")


@pytest.fixture(scope="module")
def objects_scored(objects_only: Path) -> report.ScoreReport:
    return report.score(objects_only, report.ScoreSettings(("vanilla",), 12), SilentReporter())


@pytest.fixture(scope="module")
def light_scored(light_only: Path) -> report.ScoreReport:
    return report.score(light_only, report.ScoreSettings(("vanilla",), 12), SilentReporter())


def rows(scored: report.ScoreReport, **wanted: str) -> list[dict]:
    return [row for row in scored["heatmaps"]
            if all(row[name] == value for name, value in wanted.items())]  # fmt: skip


def test_object_changes_are_found(objects_scored: report.ScoreReport) -> None:
    """Nothing else differs, so every honest method is near the truth, and chance is chance."""
    for kind in KINDS:
        found = rows(objects_scored, place="floor", kind=kind, side="both")
        assert max(row["auroc"] for row in found) > 0.88, kind
    (chance,) = rows(objects_scored, place="image", kind="random")
    assert chance["auroc"] == pytest.approx(0.5, abs=0.06)
    assert chance["precision"] == pytest.approx(chance["base_rate"], abs=0.06)
    for row in objects_scored["heatmaps"]:
        if row["auroc_low"] is not None:
            assert row["auroc_low"] - 1e-6 <= row["auroc"] <= row["auroc_high"] + 1e-6


def test_only_the_active_factor_is_to_blame(objects_scored: report.ScoreReport) -> None:
    (row,) = objects_scored["factors"]
    assert row["factor"] == "objects"
    assert row["cost"] == pytest.approx(row["gain"])
    assert objects_scored["objects"]


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("world") / "all.s2r"
    words = ["ingest", "world", "--instances", "6", "--store", str(path)]
    assert main(words) == 0
    pretrained.add_pretrained_models(path)
    precompute(path, SilentReporter(), ["vanilla", "finetune"], PrecomputeOptions(()))
    return path


def test_counterfactuals_begin_and_end_at_the_stored_predictions(everything: Path) -> None:
    """Without factors the error is the sim prediction's, with all of them the real one's."""
    with s2rstore.open(everything) as store:
        judges = [
            (store.run(name), open_backend(load_model(store, name), "torch"))
            for name in ("vanilla", "finetune")
        ]
        table = Counterfactuals(GroundTruth(store), judges, 10)
        errors = table.errors({"sim": {}, "real": table.active})
        for name in ("vanilla", "finetune"):
            columns = store.run_columns(name)
            for side in ("sim", "real"):
                stored = columns.side(side).error[table.iids]
                assert np.allclose(errors[side][name], stored, atol=1e-4)
        for row in table.factor_scores():
            assert row.n == len(table.iids)
            assert row.cost.value == pytest.approx(
                row.alone.value - errors["sim"][row.run].mean(), abs=1e-9
            )
            assert row.gain.value == pytest.approx(
                errors["real"][row.run].mean() - row.without.value, abs=1e-9
            )


def test_trained_on_instances_are_left_out(everything: Path, tmp_path: Path) -> None:
    own = copy_store(everything, tmp_path / "own.s2r")
    request = TrainingRequest("vanilla", name="mine", steps=1)
    train_into_store(own, request, lambda *told: None, "s2r train")
    precompute(own, SilentReporter(), ["mine"], PrecomputeOptions(()))
    scored = report.score(own, report.ScoreSettings(("mine",), 12), SilentReporter())
    with s2rstore.open(own) as store:
        fresh = int(run_metrics.held_out(store, "mine").sum())
    if fresh:
        assert {(row["n"], row["left_out"]) for row in scored["factors"]} == {(fresh, 12 - fresh)}
    else:
        assert scored["factors"] == []
    assert fresh < 12
    assert scored["objects"] == []


def test_the_shipped_models_keep_the_order_of_the_story(everything: Path) -> None:
    """Finetuning on real images closes most of the gap; simulation is easy for all."""
    with s2rstore.open(everything) as store:
        real = {
            name: run_metrics.side_metrics(store, name, "real") for name in ("vanilla", "finetune")
        }
        sim = run_metrics.side_metrics(store, "vanilla", "sim")
    assert real["finetune"].mean_error < 0.8 * real["vanilla"].mean_error
    assert sim.mean_error < 0.4 * real["vanilla"].mean_error


def test_images_of_another_version_are_refused(everything: Path, monkeypatch) -> None:
    from s2rtools.synthetic_world.dataset import WorldData

    with s2rstore.open(everything) as store:
        true = WorldData.raw_depth
        monkeypatch.setattr(WorldData, "raw_depth", lambda self, views: true(self, views) // 2)
        with pytest.raises(RequestError, match="ingest the world again"):
            GroundTruth(store)


def test_shipped_models_know_their_own_building_alone(tmp_path: Path) -> None:
    path = tmp_path / "other.s2r"
    words = ["ingest", "world", "--instances", "2", "--size", "32", "--seed", "4"]
    assert main([*words, "--store", str(path)]) == 0
    with pytest.raises(RequestError, match="--seed 1"):
        pretrained.add_pretrained_models(path)


def test_without_object_changes_there_are_no_positives(light_scored: report.ScoreReport) -> None:
    for row in rows(light_scored, place="image"):
        assert row["auroc"] is None
        assert (row["n"], row["without"]) == (0, 24)
    for row in rows(light_scored, place="floor"):
        assert row["auroc"] is None
        assert row["base_rate"] == 0
    assert light_scored["objects"] == []
    assert {row["factor"] for row in light_scored["factors"]} == {"lights", "exposure"}
    cost = {row["factor"]: row["cost"] for row in light_scored["factors"]}
    assert cost["lights"] > 0.5


def test_equal_seeds_give_equal_text(
    objects_only: Path, objects_scored: report.ScoreReport
) -> None:
    again = report.score(objects_only, report.ScoreSettings(("vanilla",), 12), SilentReporter())
    assert json.dumps(again, sort_keys=True) == json.dumps(objects_scored, sort_keys=True)
    other = report.score(
        objects_only, report.ScoreSettings(("vanilla",), 12, seed=5), SilentReporter()
    )
    assert other["heatmaps"] != again["heatmaps"]


def test_a_score_is_kept_once_and_told(
    objects_only: Path, objects_scored: report.ScoreReport
) -> None:
    assert report.save_report(objects_only, objects_scored)
    assert not report.save_report(objects_only, objects_scored)
    with s2rstore.open(objects_only) as store:
        told = "\n".join(store_summary.summary_lines(store))
    assert "costliest factor of vanilla: objects" in told
    assert "best heatmap of vanilla: harmonised" in told


def test_what_is_noted_of_a_kind_outlives_other_kinds(objects_only: Path, tmp_path: Path) -> None:
    own = copy_store(objects_only, tmp_path / "own.s2r")
    precompute(own, SilentReporter(), ["vanilla"], PrecomputeOptions(("feature_distance",)))
    with s2rstore.open(objects_only) as before, s2rstore.open(own) as after:
        old, new = (store.provenance("run:vanilla") for store in (before, after))
    assert json.loads(new["surfaces"]) == json.loads(old["surfaces"])
    ranges = json.loads(new["heat ranges"])
    assert set(ranges) == {*json.loads(old["heat ranges"]), "feature_distance"}


def test_positive_floor_lies_where_the_objects_stand(objects_only: Path) -> None:
    with s2rstore.open(objects_only) as store:
        truth = GroundTruth(store)
        positive, visited = floor_truth(truth, "both")
        cell = store.dataset.bounds.width / positive.shape[1]
        places = [
            (part.x, part.y, max(part.half_x, part.half_y))
            for number, item in enumerate(truth.data.world.objects, 1) if number in truth.changed
            for part in (*item.sim, *item.real)
        ]  # fmt: skip
        assert visited.sum() > positive.sum() > 0
        for row, col in np.argwhere(positive):
            x, y = (col + 0.5) * cell, (row + 0.5) * cell
            assert min(np.hypot(x - a, y - b) - r for a, b, r in places) < 0.6


def test_data_without_a_truth_is_refused(tiny_store: Path) -> None:
    with (
        s2rstore.open(tiny_store) as store,
        pytest.raises(RequestError, match="ground truth is unknown"),
    ):
        GroundTruth(store)


def test_the_application_projects_like_the_precompute(objects_only: Path) -> None:
    """One instance's heat on the map is at the nearer surface there too."""
    from s2rtui.session.heatmaps import instance_grid
    from s2rtui.session.state import HeatChoice

    with s2rstore.open(objects_only) as store:
        for side in ("sim", "real"):
            choice = HeatChoice("harmonised_distance", None, side)
            whole = store.map_grid("vanilla", "harmonised_distance", side, None, "count")
            total = np.zeros_like(whole)
            for iid in range(len(store.instances)):
                grid = instance_grid(store, "vanilla", choice, iid)
                total += np.isfinite(grid)
            assert ((total > 0) == (whole > 0)).all()
