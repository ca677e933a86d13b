"""What a bootstrap draws, and how instances are split in halves, for all shapes of recordings."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rstore.metrics.bootstrap import (
    Blocks,
    block_counts,
    corrected,
    mean_replicates,
    split_into_blocks,
)
from s2rtools.gap import defaults
from s2rtools.gap.axis_result import GapSettings
from s2rtools.gap.instance_selection import bootstrap_note, random_blocks, random_halves
from s2rtools.gap.visual.kid import block_mmd
from s2rtools.gap.visual.low_dimensional_samples import principal_components
from s2rtools.gap.visual.split_half_metrics import split_half_metrics


def recorded(sizes: list[int]) -> Blocks:
    """Trajectories of these lengths."""
    return split_into_blocks(np.repeat(np.arange(len(sizes)), sizes).astype(np.int32))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(1, 120), min_size=1, max_size=40), st.integers(0, 1000))
def test_halves_are_disjoint_and_of_one_size_for_all_recordings(
    sizes: list[int], seed: int
) -> None:
    cut = recorded(sizes)
    label = np.repeat(np.arange(cut.count), cut.sizes.astype(int))
    for a, b in random_halves(cut, 3, seed):
        assert a.size == b.size >= (sum(sizes) - cut.sizes.max()) / 2
        assert not set(label[a]) & set(label[b])


@pytest.mark.parametrize("sizes", [[300, 3], [35, 1, 1, 1, 1, 1], [1] * 40, [40], [3, 300, 2]])
def test_very_unequal_trajectories_have_figures(sizes: list[int]) -> None:
    n = sum(sizes)
    sim, real = np.random.default_rng(0).normal(size=(2, n, 4)) + np.array([[[1.0]], [[0.0]]])
    found = split_half_metrics(
        sim, real, recorded(sizes), 1, {"pca": principal_components(sim, real, 2)}
    )
    assert found["n"] >= 15
    assert found["kid"]["value"] > found["kid"]["floor"]


@pytest.mark.parametrize(
    ("sizes", "whole"),
    [
        ([20] * 6, True),
        ([20] * 5, False),
        ([100, 10, 10, 10, 10, 10], False),
        ([9] * 40, True),
        ([30, 10, 20, 25, 15, 20], True),
    ],
)
def test_whole_trajectories_are_drawn_where_there_are_enough(sizes: list[int], whole: bool) -> None:
    cut = recorded(sizes)
    counts = block_counts(cut, GapSettings(50, 1))
    assert cut.by_trajectory == whole
    assert cut.unit_count == (len(sizes) if whole else cut.count)
    assert ("whole trajectories" in bootstrap_note(cut)) == whole
    alike = [len(np.unique(counts[:, cut.trajectory == t], axis=1).T) for t in range(len(sizes))]
    assert (alike == [1] * len(sizes)) == whole
    assert cut.ungrouped().unit_count == cut.count


def test_a_part_keeps_its_trajectories() -> None:
    cut = recorded([20] * 8)
    rows, part = random_blocks(cut, 100, 3)
    assert rows.size == part.start[-1] <= 100
    assert np.array_equal(rows[part.start[:-1]] // 20, part.trajectory)


def test_pairs_inside_a_trajectory_come_with_each_of_its_copies() -> None:
    rng = np.random.default_rng(1)
    cut = split_into_blocks(np.repeat(np.arange(6), 12).astype(np.int32), 4)
    pair = block_mmd(rng.normal(1, 1, size=(72, 3)), rng.normal(size=(72, 3)), cut)
    drawn = [0, 0, 0, 2, 4, 4]
    made = [(copy, b) for copy, t in enumerate(drawn) for b in np.flatnonzero(cut.trajectory == t)]
    total, count = 0.0, 0.0
    for copy, a in made:
        for other, b in made:
            if copy == other or drawn[copy] != drawn[other]:
                total += pair.excess[a, b]
                count += pair.pairs[a, b]
    counts = np.bincount(drawn, minlength=6)[cut.trajectory].astype(float)
    found = pair.replicates(counts[None, :])
    wanted = corrected(np.array([total / count]), pair.value(), 6)
    assert found == pytest.approx(wanted)


def test_intervals_hold_the_truth_where_each_trajectory_has_a_level_of_its_own() -> None:
    rng = np.random.default_rng(2)
    held = {"trajectories": 0, "blocks": 0}
    cut = recorded([30] * 8)
    for seed in range(200):
        values = np.repeat(rng.normal(size=8), 30) + rng.normal(size=240)
        for name, each in (("trajectories", cut), ("blocks", cut.ungrouped())):
            drawn = mean_replicates(values, each, GapSettings(200, seed))
            low, high = np.percentile(drawn, [2.5, 97.5])
            held[name] += low <= 0 <= high
    assert held["trajectories"] / 200 >= 0.9
    assert held["blocks"] < held["trajectories"]


def test_the_defaults_of_the_gate_are_those_of_every_bootstrap() -> None:
    assert (GapSettings().replicates, GapSettings().seed) == (defaults.REPLICATES, defaults.SEED)
