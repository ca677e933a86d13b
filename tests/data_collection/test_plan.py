"""Which poses are chosen for new real images."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.language import evaluation
from s2rtools.data_collection.batch_choice import PoseCoverage, choose_batch
from s2rtools.data_collection.candidates import CandidatePoses, PoseSimilarity, find_candidates
from s2rtools.data_collection.expected_reduction import (
    METHODS,
    Evidence,
    local_values,
    read_evidence,
    reducible_interval,
)
from s2rtools.data_collection.plan import CollectionRequest, choose_poses, plan_collection
from s2rtools.datasets.floor.free_floor import is_free
from s2rtools.synthetic_world.dataset import WorldData
from tests.support import tiny


def grid(columns: int = 12, rows: int = 6, headings: int = 4) -> CandidatePoses:
    """Places half a metre apart; the left half is room 0, the right half room 1."""
    x, y = np.meshgrid(0.5 * np.arange(columns), 0.5 * np.arange(rows))
    places = np.column_stack([x.ravel(), y.ravel()])
    turns = np.linspace(-np.pi, np.pi, headings, endpoint=False)
    rooms = (places[:, 0] >= columns / 4).astype(np.int32)
    return CandidatePoses(places, turns, np.ones((len(places), headings), bool), rooms, "a grid")


def evidence_at(candidates: CandidatePoses, real_error: np.ndarray, **changes: object) -> Evidence:
    """An instance at every candidate pose, with a sim error of 0.5 m."""
    cells = np.arange(candidates.usable.size)
    known = Evidence(
        iids=cells,
        poses=candidates.poses(cells),
        rooms=candidates.rooms_of(cells),
        trajectories=np.zeros(cells.size, np.int32),
        real_error=real_error,
        sim_error=np.full(cells.size, 0.5),
        novelty=np.ones(cells.size),
        harm=None,
        trained_poses=np.empty((0, 3)),
        trained_rooms=np.empty(0, np.int32),
    )
    return replace(known, **changes)


def chosen(candidates: CandidatePoses, evidence: Evidence, **request: object) -> np.ndarray:
    wanted = CollectionRequest("r", **request)
    values = local_values(candidates, evidence, wanted.similarity)
    return choose_poses(candidates, evidence, values, wanted).cells


def test_candidates_of_a_world_lie_on_free_floor(moved_camera_store):
    with s2rstore.open(moved_camera_store) as store:
        found = find_candidates(store)
        data = WorldData.of_store(store)
        poses = found.poses(np.flatnonzero(found.usable))
        assert is_free(data.world, poses[:, :2]).all()
        sample = poses[:: len(poses) // 40]
        assert data.world.has_content(sample).all()
        assert set(found.rooms) >= set(range(len(store.instances.room_names)))


def test_candidates_of_recorded_data_lie_near_recorded_poses(tiny_store):
    with s2rstore.open(tiny_store) as store:
        found, truth = find_candidates(store), store.instances
        offset = found.places[:, None] - np.column_stack([truth.x, truth.y])
        assert np.hypot(*offset.transpose(2, 0, 1)).min(axis=1).max() <= 0.6
        assert found.usable.all()


@pytest.mark.parametrize("method", METHODS)
def test_poses_differ_and_the_seed_matters_for_random_ones_alone(tiny_store, method):
    with s2rstore.open(tiny_store) as store:
        first, same, other = (
            plan_collection(store, CollectionRequest("vanilla", 9, method, seed)).poses
            for seed in (3, 3, 4)
        )
    assert first == same
    assert (first == other) == (method != "random")
    assert len({(pose.x_m, pose.y_m, pose.heading_deg) for pose in first}) == 9


HALL = grid(24, 8)
RIGHT = HALL.rooms_of(np.arange(HALL.usable.size)) == 1
SAME = np.full(RIGHT.size, 3.0)


def in_right_room(evidence: Evidence, budget: int = 20, **request: object) -> int:
    return np.count_nonzero(RIGHT[chosen(HALL, evidence, budget=budget, **request)])


def test_the_bad_room_gets_most_poses():
    evidence = evidence_at(HALL, np.where(RIGHT, 4.0, 0.6))
    for method in ("combined", "error"):
        assert in_right_room(evidence, method=method) > 14
    assert 7 <= in_right_room(evidence, method="uniform") <= 13


@pytest.mark.parametrize("trajectories", [1, 2, 40])
def test_intervals_of_the_reducible_error_hold_it(trajectories):
    candidates, n = grid(16, 8), 320
    held = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        cells = rng.choice(candidates.usable.size, n)
        shared = np.repeat(rng.normal(size=n // 4), 4)  # neighbours err alike
        known = evidence_at(candidates, np.zeros(candidates.usable.size))
        drawn = replace(
            known.without(slice(0, candidates.usable.size - n)),
            poses=candidates.poses(cells),
            rooms=candidates.rooms_of(cells),
            trajectories=np.arange(n) * trajectories // n,
            real_error=np.abs(3.0 + shared + 0.5 * rng.normal(size=n)),
        )
        assert len(drawn.parts()) <= 2 * 24
        found = reducible_interval(candidates, drawn, CollectionRequest("r").similarity, "combined")
        held.append(found.low <= 2.5 <= found.high < 3.5)
    assert np.mean(held) >= 0.84
    few = drawn.without(slice(0, 21))
    unknown = reducible_interval(candidates, few, CollectionRequest("r").similarity, "combined")
    assert unknown.reason == "n 299, a reducible error needs 300"


def test_error_that_simulation_shares_is_not_reducible():
    sim_error = np.where(RIGHT, 3.9, 0.2)
    evidence = evidence_at(HALL, np.where(RIGHT, 4.0, 2.0), sim_error=sim_error)
    assert in_right_room(evidence, method="error") > 10 > in_right_room(evidence, method="combined")


def test_training_images_cover_their_neighbourhood():
    covered = HALL.poses(np.flatnonzero(RIGHT))
    rooms = np.ones(len(covered), np.int32)
    evidence = evidence_at(HALL, SAME, trained_poses=covered, trained_rooms=rooms)
    assert in_right_room(evidence, 10) == 0


def test_harm_attracts_poses():
    assert in_right_room(evidence_at(HALL, SAME, harm=np.where(RIGHT, 2.0, 0.1))) > 11


def test_trained_instances_are_no_evidence_of_real_error(tmp_path):
    path = tiny.build(tmp_path / "t.s2r", trained=("vanilla",))
    with s2rstore.open(path) as store:
        evidence = read_evidence(store, "vanilla")
        trained = store.run_columns("vanilla").trained
        assert trained.any()
        assert not trained[evidence.iids].any()
        assert len(evidence) == np.count_nonzero(~trained)
        trained[:] = True
        with pytest.raises(RequestError, match="trained on all instances"):
            read_evidence(store, "vanilla")


@given(st.integers(0, 10_000), st.integers(2, 8))
def test_gains_never_grow_and_equal_what_is_covered(seed, budget):
    candidates, rng = grid(8, 4), np.random.default_rng(seed)
    usable = rng.random(candidates.usable.shape) < 0.8
    usable[0, 0] = True
    candidates = replace(candidates, usable=usable)
    weights = rng.uniform(0, 3, usable.shape)
    coverage = PoseCoverage(candidates, weights, PoseSimilarity())
    batch = choose_batch(coverage, np.flatnonzero(usable), budget)
    assert usable.flat[batch.cells].all()
    assert (np.diff(batch.gains) <= 1e-9).all()
    assert batch.gains.sum() == pytest.approx(coverage.covered_weight)
    assert coverage.covered_weight <= batch.total + 1e-9


def test_the_greedy_batch_is_that_of_full_reevaluation():
    candidates, similarity = grid(8, 4), PoseSimilarity()
    weights = np.random.default_rng(5).uniform(0, 3, candidates.usable.shape)
    batch = choose_batch(PoseCoverage(candidates, weights, similarity), np.arange(weights.size), 6)
    coverage = PoseCoverage(candidates, weights, similarity)
    for cell in batch.cells.tolist():
        gains = [coverage.gain(other) for other in range(candidates.usable.size)]
        assert coverage.gain(cell) == pytest.approx(max(gains))
        coverage.add(cell)


def test_the_expression_selects_the_nearest_instances(tiny_store):
    with s2rstore.open(tiny_store) as store:
        plan = plan_collection(store, CollectionRequest("vanilla", 12))
        text, parameters = evaluation.sql(store, plan.expression, "vanilla", None, {}, False)
        found = {row[0] for row in store.execute(text, parameters)}
        assert found == set(plan.nearest.tolist())
        truth = store.instances
        for pose, iid in zip(plan.poses, plan.nearest, strict=True):
            assert np.hypot(truth.x[iid] - pose.x_m, truth.y[iid] - pose.y_m) < 2.5


@pytest.mark.parametrize(
    ("values", "message"),
    [({"budget": 0}, "--budget 0"), ({"budget": 5001}, "--budget 5001"), ({"seed": -1}, "--seed"),
     ({"method": "best"}, "--method best")],
)  # fmt: skip
def test_wrong_requests_name_the_option(values, message):
    with pytest.raises(RequestError, match=message):
        CollectionRequest("r", **values)
