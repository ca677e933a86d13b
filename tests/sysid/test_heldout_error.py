"""Held-out error: windows of one drive are not independent, and headings are included."""

from __future__ import annotations

import numpy as np
import pytest

from s2rtools.sysid.heldout_error import HeldOut, compared, grouped_mean_replicates


def comparison_of(gains: list[list[float]], heading: float = 0.0) -> HeldOut:
    """Windows of drives whose positions improve by `gains` and headings worsen by a share."""
    drives = np.repeat(np.arange(len(gains)), [len(group) for group in gains])
    before = np.full((len(drives), 2), 1.0)
    after = np.stack([1.0 - np.concatenate(gains), before[:, 1] * (1 + heading)], axis=1)
    return compared(before, after, drives, 2000, np.random.default_rng(0))


@pytest.mark.parametrize("drives", [2, 3, 10])
def test_windows_of_one_drive_are_one_unit(drives):
    rng = np.random.default_rng(1)
    offsets = rng.normal(0.02, 0.1, drives)
    few_windows = comparison_of([[offset] * 4 for offset in offsets])
    many_windows = comparison_of([[offset] * 100 for offset in offsets])
    width = few_windows.high - few_windows.low
    assert many_windows.high - many_windows.low == pytest.approx(width, rel=0.1)
    spread = offsets.std() / np.sqrt(drives)
    assert width > 2 * spread


def test_one_worse_drive_prevents_acceptance():
    assert comparison_of([[0.1] * 20, [0.1] * 20]).helps
    assert not comparison_of([[0.1] * 20, [-0.02] * 20]).helps


def test_a_worse_heading_prevents_acceptance():
    gains = [[0.1, 0.2]] * 3
    assert comparison_of(gains, heading=-0.5).helps
    assert comparison_of(gains, heading=0.01).helps
    assert not comparison_of(gains, heading=0.1).helps


def test_intervals_over_many_drives_have_the_nominal_coverage():
    rng = np.random.default_rng(2)
    covered = 0
    for _ in range(200):
        drives = rng.normal(0.05, 0.1, 8)
        comparison = comparison_of([(drive + rng.normal(0, 0.02, 5)).tolist() for drive in drives])
        covered += comparison.low <= 0.05 <= comparison.high
    assert covered >= 180


def test_grouped_replicates_weight_all_windows_equally():
    groups = [np.full(30, 1.0), np.full(10, 0.0)]
    replicates = grouped_mean_replicates(groups, 4000, np.random.default_rng(3))
    assert set(np.round(replicates, 6)) == {0.0, 0.75, 1.0}
