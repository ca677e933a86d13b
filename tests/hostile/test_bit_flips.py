"""A flipped bit anywhere in a store is found by `verify`, or has no effect on any figure."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench import bit_flips
from tests.support import tiny
from tests.support.ingested import build_ingested_store

SAMPLE = 40


@pytest.fixture(scope="module", params=["ingested", "without checksums"])
def store(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flips")
    if request.param == "ingested":
        return build_ingested_store(folder)
    return tiny.build(folder / "t.s2r", n=6, runs=("vanilla",))


def test_no_flipped_bit_changes_anything_in_silence(store: Path) -> None:
    flips = bit_flips.sampled(store, SAMPLE, seed=1)
    found = list(bit_flips.outcomes(store, flips))
    assert [flip for flip, outcome in found if outcome == "silent"] == []
    assert sum(outcome == "found" for _, outcome in found) > SAMPLE * 0.9


def test_the_file_that_names_the_index_is_held_against_it(store: Path) -> None:
    flips = list(bit_flips.every_bit(store, lambda path: path == "CURRENT.json"))
    found = list(bit_flips.outcomes(store, flips[::41]))
    assert [flip for flip, outcome in found if outcome == "silent"] == []
