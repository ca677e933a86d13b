"""The stratified sample of `s2r collect --for evaluation`, and the mean error that it tells."""

import math
from dataclasses import replace

import numpy as np
import pytest

import s2rstore
from s2rstore.files.planned_poses import COLUMNS, PlannedPose, read_planned_poses
from s2rstore.index.transaction import edit
from s2rstore.intervals import stratified_mean
from s2rstore.metrics.sampled_mean import sampled_mean
from s2rtools.data_collection.candidates import CandidatePoses
from s2rtools.data_collection.evaluation_sample import similar_order, stratified_sample


@pytest.fixture
def candidates() -> CandidatePoses:
    """A hall of two rooms; some poses look at a wall."""
    rng = np.random.default_rng(2)
    x, y = np.meshgrid(0.5 * np.arange(20), 0.5 * np.arange(8))
    places = np.column_stack([x.ravel(), y.ravel()])
    turns = np.linspace(-np.pi, np.pi, 8, endpoint=False)
    rooms = (places[:, 0] >= 5).astype(np.int32)
    return CandidatePoses(places, turns, rng.random((len(places), 8)) < 0.8, rooms, "a hall")


@pytest.fixture
def errors(candidates: CandidatePoses) -> np.ndarray:
    """(P, H) errors that depend on room, place and heading, and rare large ones."""
    rng = np.random.default_rng(3)
    x, y = candidates.places.T[:, :, None]
    smooth = 1 + np.sin(x) + 0.3 * y + np.cos(candidates.headings) + 2 * candidates.rooms[:, None]
    return np.abs(smooth + rng.normal(0, 0.5, smooth.shape)) + 6 * (rng.random(smooth.shape) < 0.02)


def test_every_candidate_has_the_same_probability(candidates):
    rng, count = np.random.default_rng(0), 150
    drawn = np.bincount(
        np.concatenate([stratified_sample(candidates, count, rng) for _ in range(2000)]),
        minlength=candidates.usable.size,
    )
    assert not drawn[~candidates.usable.ravel()].any()
    expected = 2000 * count / candidates.count
    assert np.abs(drawn[candidates.usable.ravel()] - expected).max() < 5 * math.sqrt(expected)


def test_the_mean_is_unbiased_and_varies_less_than_that_of_random_poses(candidates, errors):
    rng, count = np.random.default_rng(1), 100
    every = errors.flat[similar_order(candidates)]
    means = [
        stratified_mean(errors.flat[stratified_sample(candidates, count, rng)]) for _ in range(800)
    ]
    values = np.array([mean.value for mean in means])
    assert abs(values.mean() - every.mean()) < 4 * values.std() / math.sqrt(values.size)
    assert values.var() < 0.75 * every.var() / count
    assert np.mean([mean.low <= every.mean() <= mean.high for mean in means]) > 0.92
    exact = np.mean([mean.sample.effective_n for mean in means if mean.sample])
    assert exact > count / 0.75


def test_an_image_counts_for_the_nearest_pose_alone(store_copy):
    """With or without a sim image."""
    iids = [3, 17, 30]
    with edit(store_copy) as draft:
        draft.rows("DELETE FROM prediction WHERE run = 'vanilla' AND side = 'sim' AND iid = 17")
    with s2rstore.open(store_copy) as store:
        poses = [
            PlannedPose(x + 0.05, y, math.degrees(heading) + 4)
            for x, y, heading in store.poses("real")[iids].tolist()
        ]
        far = replace(poses[0], heading_deg=poses[0].heading_deg + 180)
        found = sampled_mean(store, "vanilla", [*poses, far, poses[1]])
        expected = store.run_columns("vanilla").real.error[iids].mean()
    assert (found.planned, found.taken) == (5, 3)
    assert found.mean.value == pytest.approx(expected)
    assert "a mean needs" in found.mean.reason


def test_the_commands_sample_and_evaluate(tiny_store, tmp_path, s2r):
    out = tmp_path / "sample.csv"
    arguments = ["collect", tiny_store, "--for", "evaluation", "--budget", "30", "--out", out]
    assert "a sample of 30 of" in s2r(*arguments).printed
    assert s2r(*arguments, "--json").json["poses"][0].keys() == set(COLUMNS)
    assert len(read_planned_poses(out)) == 30
    found = s2r("evaluate", tiny_store, "--run", "vanilla", "--sample", out, "--json").json
    assert found["sample"]["planned"] == 30
    text = s2r("evaluate", tiny_store, "--run", "vanilla", "--sample", out).printed
    assert "images within 0.5 m and 20 degrees of 30 sampled poses" in text
    for option, value in (("--run", "vanilla"), ("--save", "x"), ("--method", "error")):
        s2r(*arguments, option, value).assert_refused(f"{option}: not with --for evaluation")
    s2r(*arguments[:4], "--budget", "5000").assert_refused("--budget 5000: there are")
