"""True gains and shares: equal to direct renderings, complete, and scored end to end."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store
from s2rtools.models.preprocessing import preprocess
from s2rtools.scoring import tables
from s2rtools.scoring.counterfactual_errors import EvaluatedRuns, open_runs
from s2rtools.scoring.factor_shares import measure_shares
from s2rtools.scoring.ground_truth import GroundTruth
from s2rtools.scoring.harm_report import heatmaps_of, kind_estimates
from s2rtools.scoring.object_gains import ObjectGains, measure_object_gains
from s2rtools.scoring.repair_curves import RepairErrors, measure_repairs, repair_scores
from s2rtools.scoring.report import save_report
from s2rtools.synthetic_world.factors import FACTOR_GROUPS
from s2rtools.synthetic_world.renderer import RayCaster
from tests.support.copies import copy_store

RUNS = ("vanilla", "finetune")


@pytest.fixture(scope="module")
def store(world_with_all_factors: Path) -> Iterator[Store]:
    with s2rstore.open(world_with_all_factors) as opened:
        yield opened


@pytest.fixture(scope="module")
def truth(store: Store) -> GroundTruth:
    return GroundTruth(store)


@pytest.fixture(scope="module")
def evaluated(store: Store) -> EvaluatedRuns:
    return open_runs(store, RUNS)


@pytest.fixture(scope="module")
def gains(truth: GroundTruth, evaluated: EvaluatedRuns) -> ObjectGains:
    return measure_object_gains(truth, evaluated, 12)


def direct_error(truth: GroundTruth, evaluated: EvaluatedRuns, run: str, iid: int,
                 restored: tuple[int, ...]) -> float:  # fmt: skip
    """Position error on one real view, rendered on its own."""
    data, severities = truth.data, truth.data.severities("real")
    scene = data.world.scene(severities, restored)
    views = RayCaster(scene).render(truth.poses[iid : iid + 1], data.camera("real"))
    views = data.sensed(views, severities, truth.numbers[iid : iid + 1])
    depth, domain = data.raw_depth(views), truth.store.domain("real")
    (backend,) = [backend for record, backend in evaluated if record.run == run]
    x = preprocess(views.rgb, depth, domain.depth_scale, backend.model.contract, depth > 0)
    return float(np.hypot(*(backend.forward_all(x).pose[0, :2] - truth.poses[iid, :2])))


def test_a_gain_is_the_difference_of_two_renderings(truth, evaluated, gains):
    assert gains.view.size >= 3
    for pair in range(0, gains.view.size, 3):
        iid, item = int(gains.iids[gains.view[pair]]), int(gains.item[pair])
        for run in RUNS:
            before = direct_error(truth, evaluated, run, iid, ())
            after = direct_error(truth, evaluated, run, iid, (item,))
            assert gains.gain[run][pair] == pytest.approx(before - after, abs=1e-4)


def test_gains_begin_at_the_stored_errors(store, gains):
    for run in RUNS:
        stored = store.run_columns(run).real.error[gains.iids]
        assert np.allclose(gains.before[run], stored, atol=1e-4)


def test_the_pairs_are_the_visible_objects(truth, gains):
    """Each pair's pixels show the object in one of the scenes; its share is large enough."""
    pixels = gains.pixels("vanilla", "real")
    assert pixels.shape == (gains.view.size, 64, 64)
    assert (pixels.mean(axis=(1, 2)) >= 0.004).all()
    camera = truth.data.camera("real")
    for pair in range(0, gains.view.size, 3):
        pose = truth.poses[gains.iids[gains.view[pair]]][None]
        shown = [
            truth.data.renderer(scene).render(pose, camera, samples=0).identity[0]
            == gains.item[pair]
            for scene in ("sim", "real")
        ]
        assert np.array_equal(pixels[pair], shown[0] | shown[1])


@pytest.mark.parametrize("size", [(6, 6), (64, 64), (48, 40)])
def test_a_uniform_map_sums_to_the_covered_area(gains, size):
    maps = np.full((len(gains.iids), *size), 1 / (size[0] * size[1]), dtype=np.float32)
    area = gains.pixels("vanilla", "real").mean(axis=(1, 2))
    total = gains.estimates("vanilla", "real", maps, in_metres=True)
    assert total == pytest.approx(area, rel=1e-5)
    mean = gains.estimates("vanilla", "real", maps, in_metres=False)
    assert mean == pytest.approx(maps[0, 0, 0], rel=1e-5)
    maps[:] = np.nan
    assert (gains.estimates("vanilla", "real", maps, in_metres=True) == 0).all()
    assert np.isnan(gains.estimates("vanilla", "real", maps, in_metres=False)).all()


def test_fewer_instances_are_spread(truth, evaluated):
    few = measure_object_gains(truth, evaluated[:1], 4)
    assert few.iids.tolist() == [0, 3, 7, 11]


def test_repairs_of_several_objects_are_rendered(truth, evaluated, gains):
    repairs = measure_repairs(truth, evaluated, gains)
    assert repairs.views.size, "a view shows two objects"
    view = int(repairs.views[0])
    several = max(repairs.errors["vanilla"][0], key=len)
    items = tuple(int(gains.item[pair]) for pair in several)
    direct = direct_error(truth, evaluated, "vanilla", int(gains.iids[view]), items)
    assert repairs.errors["vanilla"][0][several] == pytest.approx(direct, abs=1e-4)
    for run in RUNS:
        perfect = repair_scores(repairs, run, gains.gain[run])
        worst = repair_scores(repairs, run, -gains.gain[run])
        before = gains.before[run][repairs.views].mean()
        for score, bad in zip(perfect, worst, strict=True):
            assert score.best <= score.random + 1e-9
            assert score.saved.value == pytest.approx(score.random - score.error)
            assert bad.n == score.n == repairs.views.size
        assert perfect[0].error <= perfect[0].random <= worst[0].error
        tops = [gains.gain[run][gains.view == view].max() for view in repairs.views]
        assert perfect[0].error == pytest.approx(before - np.mean(tops))


def test_repair_curves_of_made_up_errors(gains):
    """Objects 0 and 1 help only together, object 2 harms when restored."""
    subsets = {frozenset(): 4.0, frozenset({0}): 4.0, frozenset({1}): 4.0, frozenset({2}): 5.0,
               frozenset({0, 1}): 1.0, frozenset({0, 2}): 5.0, frozenset({1, 2}): 5.0,
               frozenset({0, 1, 2}): 2.0}  # fmt: skip
    repairs = RepairErrors(gains, np.array([0]), {"vanilla": [subsets]})
    estimate = np.zeros(gains.view.size)
    estimate[:3] = [3.0, 1.0, 2.0]
    scores = repair_scores(repairs, "vanilla", estimate)
    assert [score.error for score in scores] == [4.0, 5.0, 2.0]
    assert [score.best for score in scores] == [4.0, 1.0, 2.0]
    assert [score.random for score in scores] == pytest.approx([13 / 3, 11 / 3, 2.0])
    unknown = np.where(estimate == 3.0, np.nan, estimate)
    assert [score.error for score in repair_scores(repairs, "vanilla", unknown)] == [5, 5, 2]


def test_shares_sum_to_the_gap(store, truth, evaluated):
    true = measure_shares(truth, evaluated, 2)
    for run in RUNS:
        assert true.shares[run].shape == (2, len(FACTOR_GROUPS))
        assert np.allclose(true.shares[run].sum(axis=1), true.gap[run], atol=1e-9)
        columns = store.run_columns(run)
        stored = columns.real.error[true.iids] - columns.sim.error[true.iids]
        assert np.allclose(true.gap[run], stored, atol=2e-4)


def test_estimates_read_the_stored_maps(store, gains):
    found = {(e.kind, e.mode, e.side): e for e in kind_estimates(store, gains, 1)}
    assert {kind for kind, _, _ in found} == {"random", "area", "pixel_difference"}
    maps = heatmaps_of(store, "vanilla", "pixel_difference", "real", "rgb", gains.iids[::-1])
    single = store.heatmap("vanilla", "pixel_difference", "real", int(gains.iids[-1]), "rgb")
    assert np.array_equal(maps[0], single, equal_nan=True)
    expected = gains.estimates("vanilla", "real", maps[::-1], in_metres=False)
    made = found["pixel_difference", "rgb", "real"]
    assert np.array_equal(made.of_run["vanilla"], expected, equal_nan=True)
    assert not made.of_other_run, "the kind has the same map for all runs"


def test_the_command_reports_and_the_store_keeps_it(world_with_all_factors, tmp_path, s2r):
    arguments = ["score", str(world_with_all_factors), "--run", "vanilla", "--run", "finetune",
                 "--harm", "--instances", "2", "--views", "4", "--json"]  # fmt: skip
    report = s2r(*arguments).json
    harm = report["harm"]
    kinds = {(row["run"], row["kind"]) for row in harm["kinds"]}
    assert {("vanilla", "area"), ("all runs", "pixel_difference")} <= kinds
    assert harm["views"] == {"vanilla": 4, "finetune": 4}
    assert harm["left_out"] == {"vanilla": 0, "finetune": 0}
    assert {row["estimator"] for row in harm["shares"]} >= {"always lighting", "even split"}
    text = "\n".join(tables.tables(report))
    assert "What harms the pose" in text
    assert "vanilla 4 (0 trained on left out)" in text
    assert "always lighting" in text
    own = copy_store(world_with_all_factors, tmp_path / "own.s2r")
    assert save_report(own, report)
    assert not save_report(own, report)
    plain = {name: part for name, part in report.items() if name != "harm"}
    assert save_report(own, {**plain, "seed": 2})
    with s2rstore.open(own) as saved:
        assert saved.provenance_object("score", "report")["seed"] == 2
        assert saved.provenance_object("score", "harm")["views"] == harm["views"]


def test_trained_instances_do_not_count(truth, evaluated, monkeypatch):
    """A run counts the instances that are new to it, among those rendered for the other."""
    known = {"vanilla": np.arange(12) % 2 == 0, "finetune": np.ones(12, bool)}
    monkeypatch.setattr(run_metrics, "population", lambda store, run: known[run])
    part = measure_object_gains(truth, evaluated, 12)
    new = part.is_new["vanilla"][part.view]
    assert part.is_new["vanilla"].tolist() == known["vanilla"].tolist()
    pairs = part.pairs("vanilla", part.gain["vanilla"])
    assert np.array_equal(pairs.gain, part.gain["vanilla"][new])
    assert (pairs.view % 2 == 0).all()
