"""Small paired data sets on disk, and a store to append to."""

from pathlib import Path

import pytest

from s2rtools.datasets.scan import Scan
from tests.datasets.helpers import ingest, scan_of
from tests.support import pairs
from tests.support.copies import copy_store

N = 8
"""Instances of each trajectory of `source`."""


@pytest.fixture
def data(tmp_path: Path) -> tuple[Path, Path]:
    header = pairs.sim2realviz(tmp_path / "data", n=N)
    return tmp_path / "data", header


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Trajectories `a`, `c` and `b` of the Sim2RealViz layout, and their calibration."""
    folder = tmp_path_factory.mktemp("source")
    return folder, pairs.sim2realviz(folder, n=N, trajectories=("a", "c", "b"))


@pytest.fixture(scope="module")
def first_store(source: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of trajectory `c`."""
    store = tmp_path_factory.mktemp("first") / "s.s2r"
    ingest("sim2realviz", source[0], store, header=source[1], trajectories=("c",))
    return store


@pytest.fixture
def store(first_store: Path, tmp_path: Path) -> Path:
    return copy_store(first_store, tmp_path / "s.s2r")


@pytest.fixture
def scan(source: tuple[Path, Path]) -> Scan:
    return scan_of("sim2realviz", source[0], header=source[1])
