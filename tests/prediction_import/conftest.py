"""A store of 24 pairs in two trajectories, with images, times and no run."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rtui.cli import main
from tests.support import pairs
from tests.support.copies import copy_store


@pytest.fixture(scope="session")
def paired_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """No test modifies it."""
    root = tmp_path_factory.mktemp("paired")
    manifest = pairs.manifest(root / "data", n=24)
    store = root / "s.s2r"
    assert main(["ingest", "csv", str(manifest), "--store", str(store), "--size", "32"]) == 0
    return store


@pytest.fixture
def store(paired_store: Path, tmp_path: Path) -> Path:
    """A private copy."""
    return copy_store(paired_store, tmp_path / "s.s2r")
