"""The split of a run's instances into those of the fit and those of the judgement."""

from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import s2rstore
from s2rstore.errors import InconclusiveError
from s2rstore.index.transaction import edit
from s2rtools.suggestions.held_out_split import SplitPart, split_instances
from s2rtools.suggestions.robust_fit import RobustFit
from s2rtools.suggestions.sliders import Slider
from tests.support import tiny
from tests.support.copies import copy_store


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Vanilla was trained on four of five instances."""
    path = tmp_path_factory.mktemp("split") / "s.s2r"
    return tiny.build(path, n=160, trained=("vanilla",))


def test_no_instance_is_in_both_parts_and_each_consists_of_blocks_of_neighbours(
    store,
):
    with s2rstore.open(store) as opened:
        fit, judge = split_instances(opened, "dataaug", 1000, 1000)
        assert not set(fit.iids) & set(judge.iids)
        assert set(fit.iids) | set(judge.iids) == set(range(160))
        assert not set(fit.units) & set(judge.units)
        for part in (fit, judge):
            for block in np.unique(part.units):
                iids = part.iids[part.units == block]
                assert (np.diff(iids) == 1).all()
                assert np.unique(opened.instances.trajectory[iids]).size == 1
            assert np.unique(part.units).size >= 3


def test_trained_instances_are_in_neither_part(store):
    with s2rstore.open(store) as opened:
        trained = set(np.flatnonzero(opened.run_columns("vanilla").trained))
        assert trained
        for part in split_instances(opened, "vanilla", 1000, 1000):
            assert not trained & set(part.iids)


def test_fewer_instances_are_spread_over_the_part(store):
    with s2rstore.open(store) as opened:
        every, _ = split_instances(opened, "dataaug", 1000, 1000)
        some, judge = split_instances(opened, "dataaug", 20, 12)
    assert (some.iids.size, judge.iids.size) == (20, 12)
    assert set(some.iids) <= set(every.iids)
    assert {some.iids[0], some.iids[-1]} == {every.iids[0], every.iids[-1]}


def test_too_few_new_instances_are_inconclusive(tmp_path):
    path = tiny.build(tmp_path / "s.s2r", n=40, trained=("vanilla",))
    with s2rstore.open(path) as opened, pytest.raises(InconclusiveError, match="needs 16"):
        split_instances(opened, "vanilla", 10, 10)


def with_trajectories(store: Path, path: Path, lengths: list[int]) -> Path:
    """A copy whose instances belong to trajectories of other lengths."""
    copy_store(store, path)
    first = 0
    with edit(path) as draft:
        for name in ("a", "b"):
            draft.delete("trajectory", trajectory=name)
        for number, length in enumerate(lengths):
            draft.insert_row("trajectory", {"trajectory": f"t{number}", "instances": length})
            for seq in range(length):
                changes = {"trajectory": f"t{number}", "seq": seq}
                draft.update("instance", {"iid": first + seq}, changes)
            first += length
    return path


@pytest.mark.parametrize(
    "lengths", [[27, 27, 27, 27, 26, 26], [10, 40, 10, 40, 10, 40, 10], [16] * 10]
)
def test_six_and_more_trajectories_are_divided_as_a_whole(store, tmp_path, lengths):
    path = with_trajectories(store, tmp_path / "many.s2r", lengths)
    with s2rstore.open(path) as opened:
        fit, judge = split_instances(opened, "dataaug", 1000, 1000)
        trajectory = opened.instances.trajectory
        for part in (fit, judge):
            np.testing.assert_array_equal(part.units, trajectory[part.iids])
        assert not set(fit.units) & set(judge.units)
        assert np.unique(judge.units).size - np.unique(fit.units).size in (0, 1)
        assert fit.iids.size + judge.iids.size == 160
        assert min(fit.iids.size, judge.iids.size) >= 60


def test_one_long_trajectory_among_six_leaves_alternating_blocks(store, tmp_path):
    path = with_trajectories(store, tmp_path / "long.s2r", [80, 16, 16, 16, 16, 16])
    with s2rstore.open(path) as opened:
        fit, judge = split_instances(opened, "dataaug", 1000, 1000)
        trajectory = opened.instances.trajectory
        assert set(trajectory[fit.iids]) & set(trajectory[judge.iids])


LEVELS = np.array([1.0, 3.0, 2.0, 5.0])
TRAJECTORIES = np.repeat(np.arange(4), 30)


def test_the_mean_of_a_part_is_about_trajectories_like_its_own():
    """Student's interval of four levels, where the instances alone would be far more certain."""
    part = SplitPart(np.arange(120), TRAJECTORIES, TRAJECTORIES)
    found = part.mean(LEVELS[TRAJECTORIES])
    margin = stats.t.ppf(0.975, 3) * LEVELS.std(ddof=1) / 2
    assert found.high - found.low >= 2 * margin
    assert part.unit_blocks.unit_count == 4
    assert part.mean(LEVELS[TRAJECTORIES], 4).low < found.low


def test_intervals_of_fitted_values_are_over_the_units_of_the_fit():
    """Residuals (n, 1) of a value that each trajectory has another truth of."""

    def residuals(values) -> np.ndarray:
        return 1e-3 * (values["level"] - LEVELS[TRAJECTORIES])[:, None]

    part = SplitPart(np.arange(120), TRAJECTORIES, TRAJECTORIES)
    match = RobustFit(residuals, np.ones(1), part.unit_blocks)
    level = Slider("level", "level", "m", 0.0, 0.0, 10.0, 3)
    found = match.intervals({"level": float(LEVELS.mean())}, [level])["level"]
    margin = stats.t.ppf(0.975, 3) * LEVELS.std(ddof=1) / 2
    assert 1.7 * margin < found.high - found.low < 3 * margin
