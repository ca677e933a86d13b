"""The split of a run's instances into those of the fit and those of the judgement."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import s2rstore
from s2rstore.errors import InconclusiveError
from s2rtools.suggestions.held_out_split import split_instances
from tests.support import tiny


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Vanilla was trained on four of five instances."""
    path = tmp_path_factory.mktemp("split") / "s.s2r"
    return tiny.build(path, n=160, trained=("vanilla",))


def test_no_instance_is_in_both_parts(store: Path) -> None:
    with s2rstore.open(store) as opened:
        fit, judge = split_instances(opened, "dataaug", 1000, 1000)
        assert not set(fit.iids) & set(judge.iids)
        assert set(fit.iids) | set(judge.iids) == set(range(160))
        assert not set(fit.blocks) & set(judge.blocks)


def test_the_parts_are_blocks_of_neighbours_of_one_trajectory(store: Path) -> None:
    with s2rstore.open(store) as opened:
        for part in split_instances(opened, "dataaug", 1000, 1000):
            for block in np.unique(part.blocks):
                iids = part.iids[part.blocks == block]
                assert (np.diff(iids) == 1).all()
                assert np.unique(opened.instances.trajectory[iids]).size == 1
            assert np.unique(part.blocks).size >= 3


def test_trained_instances_are_in_neither_part(store: Path) -> None:
    with s2rstore.open(store) as opened:
        trained = set(np.flatnonzero(opened.run_columns("vanilla").trained))
        assert trained
        for part in split_instances(opened, "vanilla", 1000, 1000):
            assert not trained & set(part.iids)


def test_fewer_instances_are_spread_over_the_part(store: Path) -> None:
    with s2rstore.open(store) as opened:
        every, _ = split_instances(opened, "dataaug", 1000, 1000)
        some, judge = split_instances(opened, "dataaug", 20, 12)
    assert (some.iids.size, judge.iids.size) == (20, 12)
    assert set(some.iids) <= set(every.iids)
    assert {some.iids[0], some.iids[-1]} == {every.iids[0], every.iids[-1]}


def test_too_few_new_instances_are_inconclusive(tmp_path: Path) -> None:
    path = tiny.build(tmp_path / "s.s2r", n=40, trained=("vanilla",))
    with s2rstore.open(path) as opened, pytest.raises(InconclusiveError, match="needs 16"):
        split_instances(opened, "vanilla", 10, 10)
