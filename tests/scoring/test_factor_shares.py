"""Scores of estimated shares of the gap."""

import numpy as np
import pytest

from s2rtools.scoring.factor_shares import (
    TrueShares,
    constant_answers,
    largest_share_named,
    score_shares,
)
from s2rtools.synthetic_world.factors import FACTOR_GROUPS, FACTORS


def test_every_factor_that_changes_images_has_a_group():
    for factor in FACTORS.values():
        assert (factor.group in FACTOR_GROUPS) != factor.moves_robot
    assert {factor.group for factor in FACTORS.values()} - {None} == set(FACTOR_GROUPS)


@pytest.fixture(scope="module")
def true() -> TrueShares:
    n = 100
    shares = np.random.default_rng(1).normal([0.8, 0.1, 0.3, 0.0, 0.1], 0.3, (n, 5))
    is_new = np.arange(n) % 10 != 0
    iids = np.arange(n)
    return TrueShares(iids, iids // 50, {"r": shares}, {"r": shares.sum(axis=1)}, {"r": is_new})


def test_true_shares_score_one(true):
    for score in score_shares(true, "r", "truth", true.shares["r"]):
        assert score.correlation.value == pytest.approx(1)
        assert score.error.value == 0
        assert (score.n, score.left_out) == (90, 10)
    largest = np.argmax(true.shares["r"], axis=1)
    assert largest_share_named(true, "r", largest).value == 1
    assert largest_share_named(true, "r", (largest + 1) % 5).value == 0


def test_constant_answers_know_the_gap_only(true):
    answers = constant_answers(true, "r")
    for answer in answers.values():
        assert np.allclose(answer.sum(axis=1), true.gap["r"])
    always = score_shares(true, "r", "always lighting", answers["always lighting"])
    assert np.isnan([score.correlation.value for score in always[1:]]).all()
    assert all(score.error.value > 0.1 for score in always)
    mean = [score.mean for score in always]
    assert mean == pytest.approx(true.shares["r"][true.is_new["r"]].mean(axis=0))


def test_shares_of_another_shape_are_refused(true):
    with pytest.raises(ValueError, match="shape"):
        score_shares(true, "r", "short", true.shares["r"][:10])
