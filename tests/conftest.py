"""Fixtures shared by all test packages."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path

import pytest
from hypothesis import settings
from textual import _wait

from tests.support import pairs, tiny
from tests.support.copies import copy_store

settings.register_profile("any load", deadline=None)  # how long an example takes says nothing
settings.load_profile("any load")

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")
os.environ["S2R_BACKEND"] = "torch"
"""The default measures which backend is the fastest, so that values would depend on the machine."""
_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
os.environ.setdefault("NUMBA_CACHE_DIR", str(_CACHE / "numba"))

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"

_wait.SLEEP_GRANULARITY, _wait.SLEEP_IDLE = 0.002, 0.0002
"""Seconds; Textual's defaults wait 20 ms of idle time after each key and slow the tests down."""

FOLDERS_WITH_SHARED_FIXTURES = ("gap", "terminal", "nightly", "sysid", "training")
"""Folders whose fixtures are expensive: one xdist worker runs all tests of such a folder."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    tests_folder = Path(__file__).parent
    for item in items:
        folder = item.path.relative_to(tests_folder).parts[0]
        if folder in FOLDERS_WITH_SHARED_FIXTURES and not item.get_closest_marker("xdist_group"):
            item.add_marker(pytest.mark.xdist_group(folder))


@pytest.fixture(autouse=True)
def user_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A separate folder per test for the user's selections, notes and tags."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "share"))
    return tmp_path / "share" / "s2rtui"


@pytest.fixture
def declared_entry_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The entry points of pyproject.toml, whatever an earlier installation has recorded."""
    project = tomllib.loads(PYPROJECT.read_text(encoding="utf-8"))["project"]
    folder = tmp_path / "installed" / f"{project['name']}-{project['version']}.dist-info"
    folder.mkdir(parents=True)
    metadata = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (folder / "METADATA").write_text(metadata, encoding="utf-8")
    lines = []
    for group, points in project["entry-points"].items():
        lines += [f"[{group}]", *(f"{name} = {target}" for name, target in points.items())]
    (folder / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")
    monkeypatch.syspath_prepend(folder.parent)


@pytest.fixture(scope="session")
def tiny_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A synthetic store that no test modifies."""
    return tiny.build(tmp_path_factory.mktemp("tiny") / "tiny.s2r")


@pytest.fixture
def store_copy(tiny_store: Path, tmp_path: Path) -> Path:
    """A private copy of the synthetic store, which the test may modify."""
    return copy_store(tiny_store, tmp_path / "own.s2r")


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The Sim2RealViz data set in the folder named by S2R_DATA."""
    folder = os.environ.get("S2R_DATA")
    if not folder:
        pytest.skip("S2R_DATA does not name the Sim2RealViz data")
    return Path(folder)


@pytest.fixture(scope="session")
def trained_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of 40 pairs in two shards with a briefly trained model and no computed run."""
    root = tmp_path_factory.mktemp("trained")
    os.environ["XDG_CACHE_HOME"] = str(root / "cache")
    from s2rtools.datasets import IMPORTERS
    from s2rtools.datasets.scan import ScanOptions
    from s2rtools.datasets.writing.build import build
    from s2rtools.training.train_into_store import TrainingRequest, train_into_store

    header = pairs.sim2realviz(root / "data", n=40)
    options = ScanOptions(header=header, frame=(64, 64))
    scan = IMPORTERS["sim2realviz"](root / "data", options)
    build(scan, root / "s.s2r", "s2r ingest", False, lambda steps: None)
    request = TrainingRequest("vanilla", steps=3)
    train_into_store(root / "s.s2r", request, lambda *progress: None, "s2r train")
    return root / "s.s2r"


@pytest.fixture(scope="session")
def moved_camera_store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small default world with runs of one model whose cameras are moved; no test modifies it.

    Run `zero` sets all adjustments to 0, `up` raises the sim camera and brightens its images,
    `low` lowers the real camera; all runs are computed.
    """
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtools.training import pretrained
    from s2rtui.cli import main
    from tests.support.silent_reporter import SilentReporter

    path = tmp_path_factory.mktemp("moved") / "world.s2r"
    assert main(["ingest", "world", "--instances", "4", "--store", str(path)]) == 0
    pretrained.add_pretrained_models(path)
    moves = {
        "zero": "sim:camera_height=0,camera_pitch=0,camera_fov=0",
        "up": "sim:camera_height=0.1,brightness=1.2,camera_pitch=-5,camera_fov=6",
        "low": "real:camera_height=-0.1,camera_fov=-4",
    }
    for name, chain in moves.items():
        arguments = [
            "run",
            "add",
            name,
            "--model",
            "vanilla",
            "--adjust",
            chain,
            "--store",
            str(path),
        ]
        assert main(arguments) == 0
    kinds = ("feature_distance", "pixel_difference", "harmonised_distance")
    precompute(path, SilentReporter(), ["vanilla", "zero", "low"], PrecomputeOptions(kinds))
    precompute(path, SilentReporter(), ["up"], PrecomputeOptions(kinds, workers=2))
    return path
