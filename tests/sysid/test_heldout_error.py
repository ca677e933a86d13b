"""Held-out error: windows of one drive are no independent evidence, and headings count."""

from __future__ import annotations

import numpy as np
import pytest

from s2rtools.sysid.heldout_error import HeldOut, compared, grouped_mean_replicates


def judged(gains: list[list[float]], heading: float = 0.0) -> HeldOut:
    """Drives' windows whose places get better by so much, headings worse by a share."""
    drives = np.repeat(np.arange(len(gains)), [len(group) for group in gains])
    before = np.full((len(drives), 2), 1.0)
    after = np.stack([1.0 - np.concatenate(gains), before[:, 1] * (1 + heading)], axis=1)
    return compared(before, after, drives, 2000, np.random.default_rng(0))


@pytest.mark.parametrize("drives", [2, 3, 10])
def test_windows_of_one_drive_count_as_one(drives: int) -> None:
    rng = np.random.default_rng(1)
    offsets = rng.normal(0.02, 0.1, drives)
    few = judged([[offset] * 4 for offset in offsets])
    many = judged([[offset] * 100 for offset in offsets])
    width = few.high - few.low
    assert many.high - many.low == pytest.approx(width, rel=0.1)
    spread = offsets.std() / np.sqrt(drives)
    assert width > 2 * spread


def test_one_drive_in_which_it_got_worse_is_enough_to_doubt() -> None:
    assert judged([[0.1] * 20, [0.1] * 20]).helps
    assert not judged([[0.1] * 20, [-0.02] * 20]).helps


def test_a_heading_that_got_worse_does_not_help() -> None:
    gains = [[0.1, 0.2]] * 3
    assert judged(gains, heading=-0.5).helps
    assert judged(gains, heading=0.01).helps
    assert not judged(gains, heading=0.1).helps


def test_intervals_over_many_drives_cover_the_truth() -> None:
    rng = np.random.default_rng(2)
    covered = 0
    for _ in range(200):
        drives = rng.normal(0.05, 0.1, 8)
        found = judged([(drive + rng.normal(0, 0.02, 5)).tolist() for drive in drives])
        covered += found.low <= 0.05 <= found.high
    assert covered >= 180


def test_grouped_mean_replicates_weigh_windows_alike() -> None:
    groups = [np.full(30, 1.0), np.full(10, 0.0)]
    drawn = grouped_mean_replicates(groups, 4000, np.random.default_rng(3))
    assert set(np.round(drawn, 6)) == {0.0, 0.75, 1.0}
