"""Fixtures that every room shares."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.support import tiny

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")


@pytest.fixture(scope="session")
def tiny_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic store that no test writes to."""
    return tiny.build(tmp_path_factory.mktemp("tiny") / "tiny.s2r")


@pytest.fixture
def own_store(tmp_path: Path) -> Path:
    """A synthetic store of this test's own."""
    return tiny.build(tmp_path / "own.s2r")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The Sim2RealViz data, named by S2R_DATA."""
    folder = os.environ.get("S2R_DATA")
    if not folder:
        pytest.skip("S2R_DATA does not name the Sim2RealViz data")
    return Path(folder)
