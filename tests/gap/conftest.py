"""A store that the tests of a folder share."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support import tiny


@pytest.fixture(scope="session")
def store_of_200(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Read it, or copy it."""
    return tiny.build(tmp_path_factory.mktemp("gap") / "s.s2r", n=200)
