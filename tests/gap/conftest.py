"""A store shared by the tests of the gap."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support import tiny


@pytest.fixture(scope="session")
def store_of_400(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of 400 instances; tests that modify it copy it first."""
    return tiny.build(tmp_path_factory.mktemp("gap") / "s.s2r", n=400, trained=tiny.RUNS)
