"""A flipped bit anywhere in a store is detected by `verify` or affects no result."""

from pathlib import Path

import pytest

from bench import bit_flips
from tests.conftest import BuildOnce
from tests.support.copies import copy_store
from tests.support.ingested import build_ingested_store

SAMPLE = 20


@pytest.fixture
def store(build_once: BuildOnce, tmp_path: Path) -> Path:
    return copy_store(build_once("ingested.s2r", build_ingested_store), tmp_path / "s.s2r")


def test_no_flipped_bit_changes_results_undetected(store):
    flips = bit_flips.sampled(store, SAMPLE, seed=1)
    outcomes = list(bit_flips.outcomes(store, flips))
    assert [flip for flip, outcome in outcomes if outcome == "silent"] == []
    assert sum(outcome == "found" for _, outcome in outcomes) > SAMPLE * 0.9


def test_flipped_bits_of_the_current_file_are_detected(store):
    flips = list(bit_flips.every_bit(store, lambda path: path == "CURRENT.json"))
    outcomes = list(bit_flips.outcomes(store, flips[::127]))
    assert [flip for flip, outcome in outcomes if outcome == "silent"] == []
