"""The stratified sample of `s2r collect --for evaluation`, and the mean error that it tells."""

import math
from dataclasses import replace

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import planned_poses as files
from s2rstore.files.planned_poses import PlannedPose, PoseSample, read_pose_sample
from s2rstore.index.transaction import edit
from s2rstore.intervals import stratified_mean
from s2rstore.metrics.sampled_mean import sampled_mean
from s2rtools.common.command_line.row_formats import csv_text
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


def test_every_candidate_has_the_same_probability_and_is_drawn_once(candidates):
    rng, count = np.random.default_rng(0), 350
    drawn = np.array([stratified_sample(candidates, count, rng) for _ in range(400)])
    assert all(np.unique(one).size == count for one in drawn)
    times = np.bincount(drawn.ravel(), minlength=candidates.usable.size)
    assert not times[~candidates.usable.ravel()].any()
    expected = 400 * count / candidates.count
    assert np.abs(times[candidates.usable.ravel()] - expected).max() < 5 * math.sqrt(expected)


def test_the_mean_is_unbiased_and_varies_less_than_that_of_random_poses(candidates, errors):
    rng, count = np.random.default_rng(1), 100
    every = errors.flat[similar_order(candidates)]
    means = [
        stratified_mean(errors.flat[stratified_sample(candidates, count, rng)]) for _ in range(300)
    ]
    values = np.array([mean.value for mean in means])
    assert abs(values.mean() - every.mean()) < 4 * values.std() / math.sqrt(values.size)
    assert values.var() < 0.75 * every.var() / count
    assert np.mean([mean.low <= every.mean() <= mean.high for mean in means]) > 0.92
    exact = np.mean([mean.sample.effective_n for mean in means if mean.sample])
    assert exact > count / 0.75


def test_an_image_counts_for_the_nearest_pose_alone_if_it_is_new(store_copy):
    """With or without a sim image; training on the sim image alone does not matter."""
    iids = [13, 17, 30, 25, 3]
    with edit(store_copy) as draft:
        draft.rows("DELETE FROM prediction WHERE run = 'vanilla' AND side = 'sim' AND iid = 17")
        draft.rows("UPDATE prediction SET split = CASE side WHEN 'sim' THEN 'train' END "
                   "WHERE run = 'vanilla' AND iid = 30")  # fmt: skip
        draft.rows("UPDATE prediction SET x = NULL, y = NULL, heading = NULL, error = NULL, "
                   "heading_error = NULL WHERE run = 'vanilla' AND iid = 25")  # fmt: skip
    with s2rstore.open(store_copy) as store:
        poses = [
            PlannedPose(x + 0.05, y, math.degrees(heading) + 4)
            for x, y, heading in store.poses("real")[iids].tolist()
        ]
        far = replace(poses[0], heading_deg=poses[0].heading_deg + 180)
        sample = PoseSample((*poses, far, poses[1]), 10, "hall")
        found = sampled_mean(store, "vanilla", sample)
        expected = store.run_columns("vanilla").real.error[iids[:3]].mean()
        with pytest.raises(RequestError, match="the sample is of a store with 500"):
            sampled_mean(store, "vanilla", replace(sample, instances=500))
    assert (found.planned, found.missing, found.lost) == (7, 3, 1)
    assert found.mean.value == pytest.approx(expected)
    reason = "3 of 7 poses have no image and 1 of 4 images are not localised"
    assert found.mean.reason == f"{reason}; the mean may be biased"
    assert "of the localised images over the candidates (hall)" in found.text
    assert "0.05 m and 4.0 degrees at most" in found.text


def test_the_commands_sample_and_evaluate(store_copy, tmp_path, s2r):
    out = tmp_path / "sample.csv"
    arguments = ["collect", store_copy, "--for", "evaluation", "--budget", "30", "--out", out]
    assert "a sample of 30 of" in s2r(*arguments).printed
    assert s2r(*arguments, "--json").json["poses"][0].keys() == set(files.STRATUM_COLUMNS)
    evaluate = ["evaluate", store_copy, "--run", "vanilla", "--sample", out]
    found = s2r(*evaluate, "--json").json
    assert (found["sample"]["taken"], found["sample"]["missing"]) == (0, 30)
    assert "30 of 30 poses have no image" in s2r(*evaluate).printed
    with edit(store_copy) as draft:
        draft.rows("DELETE FROM prediction WHERE run = 'vanilla' AND side = 'sim'")
    out.write_text(out.read_text().replace(" of 30,40,", " of 30,0,"))
    found = s2r(*evaluate, "--json").json
    assert found["sample"]["taken"] > 0
    assert "no instance with both images" in found["reason"]
    for option, value in (("--run", "vanilla"), ("--save", "x"), ("--method", "error")):
        s2r(*arguments, option, value).assert_refused(f"{option}: not with --for evaluation")
    s2r(*arguments[:4], "--budget", "5000").assert_refused("--budget 5000: there are")


def test_a_file_has_one_pose_of_each_stratum(tmp_path):
    path = tmp_path / "sample.csv"
    sample = PoseSample(tuple(PlannedPose(x, 2, 3, "hall") for x in (1, 2, 3)), 40, "a hall")

    def read(rows):
        path.write_text(csv_text(files.SAMPLE_COLUMNS, rows))
        return read_pose_sample(path)

    first, *others = sample.file_rows
    assert read([*others, first]) == sample
    for rows in ([], others, [first, *others, first], [(*first[:4], "", *first[5:]), *others]):
        with pytest.raises(RequestError, match="expected one pose of each stratum"):
            read(rows)
    path.write_text(csv_text(files.COLUMNS, files.as_rows(sample.poses)))
    with pytest.raises(RequestError, match="no column stratum"):
        read_pose_sample(path)
