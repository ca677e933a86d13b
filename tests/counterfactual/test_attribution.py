"""Attributions compared with direct computations."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from s2rtools.common.shapley import shapley_values
from s2rtools.counterfactual.attribution import integrated_gradients, pose_errors, repair_gains
from s2rtools.counterfactual.counterfactual_inputs import (
    CounterfactualInputs,
    OwnView,
    composite_inputs,
    counterfactual_inputs,
)
from s2rtools.counterfactual.gap_shares import gap_shares
from s2rtools.inference import Backend
from s2rtools.models.preprocessing import preprocess
from tests.counterfactual.test_scene_comparison import CAMERA, EQUAL, dimmed, with_box
from tests.counterfactual.views import SIZE, metres, rendered
from tests.support import networks

TRUTH = np.array([0.3, -0.2, 0.4])


@pytest.fixture(scope="module")
def backend() -> Backend:
    trunk = nn.Sequential(
        nn.Conv2d(4, 8, 3, padding=1), nn.Softplus(), nn.AvgPool2d(4),
        nn.Conv2d(8, 8, 3, padding=1), nn.Softplus(),
    )  # fmt: skip
    return Backend(networks.small_model(trunk, 8, (SIZE, SIZE)))


@pytest.fixture(scope="module")
def inputs(backend: Backend) -> CounterfactualInputs:
    image = rendered("sim", CAMERA)[2]
    real = with_box(dimmed(image))
    contract = backend.model.contract
    x = preprocess(real[0][None], real[1][None], 0.001, contract, real[2][None])[0]
    scenes = EQUAL.in_real_view(image, real)
    return counterfactual_inputs(scenes, x, real[1], real[2], EQUAL.real, 0.001, contract)


def error_of(backend: Backend, x: np.ndarray) -> np.ndarray:
    return pose_errors(backend.forward_all(x[None]).pose, TRUTH)[0]


def test_a_repair_replaces_one_segment(backend, inputs):
    assert inputs.count >= 1
    gains = repair_gains(backend, inputs, TRUTH)
    assert gains.shape == (inputs.count, 3)
    for number in range(1, inputs.count + 1):
        changed = np.where(inputs.segments == number, inputs.counterfactual, inputs.real)
        expected = error_of(backend, inputs.real) - error_of(backend, changed)
        assert np.allclose(gains[number - 1], expected, atol=1e-5)


def test_integrated_gradients_sum_to_the_difference(backend, inputs):
    values = integrated_gradients(backend, inputs, TRUTH, 8)
    assert values.shape == (3, *backend.model.contract.shape)
    expected = error_of(backend, inputs.real) - error_of(backend, inputs.counterfactual)
    sums = values.astype(np.float64).sum(axis=(1, 2, 3))
    assert np.allclose(sums, expected, atol=0.002 * np.abs(expected).max())
    assert np.allclose(inputs.in_rgb_pixels(values).sum(axis=(1, 2)), sums, atol=1e-4)


def test_the_shares_of_a_pair_sum_to_its_gap(backend):
    image = rendered("sim", CAMERA)[2]
    real = with_box(dimmed(image))
    contract = backend.model.contract
    x = [preprocess(i[0][None], i[1][None], 0.001, contract, i[2][None])[0] for i in (image, real)]
    views = [
        OwnView("sim", EQUAL.in_sim_view(image, real), EQUAL.sim, metres(image)),
        OwnView("real", EQUAL.in_real_view(image, real), EQUAL.real, metres(real)),
    ]
    composites = composite_inputs(*views, *x, contract)
    assert composites.shape == (32, *contract.shape)
    shares = gap_shares(backend, composites, TRUTH)
    gap = error_of(backend, x[1])[0] - error_of(backend, x[0])[0]
    assert shares.sum() == pytest.approx(gap, abs=1e-5)


@given(st.integers(1, 4), st.integers(0, 2**32 - 1))
def test_shapley_values_are_mean_contributions_over_all_orders(players, seed):
    values = np.random.default_rng(seed).standard_normal(1 << players)
    expected = np.zeros(players)
    orders = list(permutations(range(players)))
    for order in orders:
        coalition = 0
        for player in order:
            expected[player] += values[coalition | 1 << player] - values[coalition]
            coalition |= 1 << player
    assert np.allclose(shapley_values(values), expected / len(orders))


def test_heading_errors_wrap():
    errors = pose_errors(np.array([[0.0, 0.0, 3.1]]), np.array([3.0, 4.0, -3.1]))
    assert errors[0] == pytest.approx([5.0, 2 * np.pi - 6.2, 0.7 * 25 + 0.3 * (2 * np.pi - 6.2)])
