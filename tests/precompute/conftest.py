"""A small store whose run is not computed."""

from pathlib import Path

import pytest

from tests.conftest import BuildOnce
from tests.support.copies import copy_store
from tests.support.small_stores import build_small


@pytest.fixture(scope="session")
def small_store(build_once: BuildOnce) -> Path:
    """A store of few pairs with the run `vanilla`, which no test modifies."""
    return build_once("small.s2r", build_small)


@pytest.fixture
def small_copy(small_store: Path, tmp_path: Path) -> Path:
    return copy_store(small_store, tmp_path / "s.s2r")
