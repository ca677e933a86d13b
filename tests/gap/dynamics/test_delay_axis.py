"""The size of a delay beyond its noise, and the period that it is told in."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.delay import delay_axis, time_delay

SETTINGS = GapSettings(replicates=300)


@pytest.mark.parametrize("noise", [0.1, 0.3, 0.6])
def test_a_delay_on_the_threshold_seldom_passes(noise: float) -> None:
    rng = np.random.default_rng(3)
    spread = noise * stats.norm.ppf((np.arange(200) + 0.5) / 200)
    ends = []
    for _ in range(2000):
        late = 1 + noise * rng.standard_normal()
        found = time_delay.TimeDelay(late, 0.0, 0.0, late + spread, {}, 30.0)
        value, replicates = delay_axis.mean_size([found], SETTINGS)
        low, high = np.percentile(replicates, [2.5, 97.5])
        assert low <= value <= high
        ends.append((low > 1, high < 1))
    failed, passed = np.mean(ends, axis=0)
    assert passed < 0.036
    assert failed < 0.036


def test_a_delay_within_its_noise_is_shrunk_and_a_clear_one_is_not() -> None:
    rng = np.random.default_rng(0)
    found = delay_axis.denoised_size(np.abs(0.05 + 0.01 * rng.standard_normal(4000)), 0.01)
    assert found.mean() == pytest.approx(0.05, rel=0.01)
    assert delay_axis.denoised_size(np.array([0.0, 0.007]), 0.01).tolist() == [0.0, 0.0]
    assert delay_axis.denoised_size(np.array(0.02), 0.0) == 0.02


@pytest.mark.parametrize("period", [0.05, 0.1, 1 / 30, 1 / 60, 0.02, 0.01, 0.0125, 0.008, 0.25])
def test_one_period_measured_on_two_nights_is_one_fingerprint(period: float) -> None:
    told = {
        delay_axis.rounded_period(period * (1 + off)) for off in (-2e-3, -1e-5, 0.0, 1e-5, 2e-3)
    }
    assert len(told) == 1
    assert told.pop() == pytest.approx(period, rel=0.005)
    assert delay_axis.rounded_period(1.03 * period) != delay_axis.rounded_period(period)
