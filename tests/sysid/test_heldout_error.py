"""Held-out error: windows of one drive are not independent, and headings are included."""

import numpy as np
import pytest
from scipy import stats

from s2rtools.sysid.heldout_error import HeldOut, compared


def comparison_of(gains: list[list[float]], heading: float = 0.0) -> HeldOut:
    """Windows of drives whose positions improve by `gains` and headings worsen by a share."""
    drives = np.repeat(np.arange(len(gains)), [len(group) for group in gains])
    before = np.full((len(drives), 2), 1.0)
    after = np.stack([1.0 - np.concatenate(gains), before[:, 1] * (1 + heading)], axis=1)
    return compared(before, after, drives)


@pytest.mark.parametrize("drives", [3, 10])
def test_windows_of_one_drive_are_one_unit(drives):
    rng = np.random.default_rng(1)
    offsets = rng.normal(0.02, 0.1, drives)
    few_windows = comparison_of([[offset] * 4 for offset in offsets])
    many_windows = comparison_of([[offset] * 100 for offset in offsets])
    few, many = few_windows.ratio, many_windows.ratio
    assert (many.low, many.high) == pytest.approx((few.low, few.high))
    logs = np.log(1 - offsets)
    margin = stats.t.ppf(0.975, drives - 1) * logs.std(ddof=1) / np.sqrt(drives)
    assert margin <= np.log(few.high / few.value) <= 2 * margin


def test_one_worse_drive_prevents_acceptance():
    assert comparison_of([[0.1] * 20, [0.11] * 20, [0.1] * 20]).helps
    assert not comparison_of([[0.1] * 20, [0.1] * 20, [-0.02] * 20]).helps


def test_a_worse_heading_prevents_acceptance():
    gains = [[0.1, 0.2], [0.11, 0.2], [0.1, 0.2]]
    assert comparison_of(gains, heading=-0.5).helps
    assert comparison_of(gains, heading=0.01).helps
    assert not comparison_of(gains, heading=0.1).helps
