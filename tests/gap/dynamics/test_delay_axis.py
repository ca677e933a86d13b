"""The delay axis: noise-corrected size and rounded control period."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from s2rtools.gap.delay import delay_axis, time_delay


@pytest.mark.parametrize("noise", [0.1, 0.3, 0.6])
def test_a_delay_at_the_threshold_rarely_passes(noise):
    rng = np.random.default_rng(3)
    left_out = noise / 199 * stats.norm.ppf((np.arange(200) + 0.5) / 200) * np.sqrt(199)
    ends = []
    for _ in range(2000):
        delay = 1 + noise * rng.standard_normal()
        estimate = time_delay.TimeDelay(delay, delay + left_out, {}, 30.0)
        size = delay_axis.mean_size([estimate])
        assert size.low <= size.value <= size.high
        ends.append((size.low > 1, size.high < 1))
    failed, passed = np.mean(ends, axis=0)
    assert passed < 0.036
    assert failed < 0.036


@pytest.mark.parametrize("true", [0.02, 0.1])
@pytest.mark.parametrize("count", [2, 3])
def test_the_mean_size_of_few_drives_is_no_surer_than_their_noise(count, true):
    rng = np.random.default_rng(1)
    found = []
    for _ in range(400):
        blocks = true + 0.05 * np.sqrt(8) * rng.standard_normal((count, 8))
        left_out = (blocks.sum(axis=1, keepdims=True) - blocks) / 7
        drives = [time_delay.TimeDelay(float(drive.mean()), drive, {}, 10.0) for drive in left_out]
        found.append(delay_axis.mean_size(drives))
    assert np.mean([each.low <= true <= each.high for each in found]) >= 0.93


def test_only_a_delay_within_its_noise_is_shrunk():
    rng = np.random.default_rng(0)
    estimate = delay_axis.denoised_size(np.abs(0.05 + 0.01 * rng.standard_normal(4000)), 0.01)
    assert estimate.mean() == pytest.approx(0.05, rel=0.01)
    assert delay_axis.denoised_size(np.array([0.0, 0.007]), 0.01).tolist() == [0.0, 0.0]
    assert delay_axis.denoised_size(np.array(0.02), 0.0) == 0.02


@pytest.mark.parametrize("period", [0.05, 0.1, 1 / 30, 1 / 60, 0.02, 0.01, 0.0125, 0.008, 0.25])
def test_slightly_different_periods_have_one_fingerprint(period):
    periods = {
        delay_axis.rounded_period(period * (1 + deviation))
        for deviation in (-2e-3, -1e-5, 0.0, 1e-5, 2e-3)
    }
    assert len(periods) == 1
    assert periods.pop() == pytest.approx(period, rel=0.005)
    assert delay_axis.rounded_period(1.03 * period) != delay_axis.rounded_period(period)
