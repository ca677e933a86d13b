"""Fixtures shared by all test packages."""

import atexit
import gc
import os
import shutil
import signal
import sys
import tomllib
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import is_hypothesis_test, settings
from textual import _wait

from tests.support import linear_umap, tiny
from tests.support.copies import copy_store
from tests.support.open_stores import kept_open
from tests.support.refusals import RunCommand, run_command

settings.register_profile("suite", deadline=None, max_examples=30, derandomize=True)
settings.register_profile("deep", deadline=None, max_examples=400, print_blob=True)
settings.load_profile("suite")

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")
os.environ["S2R_BACKEND"] = "torch"
"""The default takes the fastest backend that a machine has, so that values would depend on it."""
_CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
os.environ.setdefault("NUMBA_CACHE_DIR", str(_CACHE / "numba"))

sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
"""Each of the programs that tests start would compile all modules again."""

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"

_wait.SLEEP_GRANULARITY, _wait.SLEEP_IDLE = 0.002, 0.0002
"""Seconds; Textual's defaults wait 20 ms of idle time after each key and slow the tests down."""

FOLDERS_OF_ONE_PROCESS = (
    "cluster", "examples", "nightly", "prediction_import", "ros", "scoring", "serve", "ssh",
    "sysid",
)  # fmt: skip
"""Folders that share expensive fixtures, or start programs of which few run at once."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--deep", action="store_true",
        help="run the slow and exhaustive tests, and property tests with more examples",
    )  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    # A shell's background job ignores SIGINT and nohup SIGHUP, and so would the tests' programs.
    usual = {signal.SIGINT: signal.default_int_handler, signal.SIGHUP: signal.SIG_DFL}
    for number, handler in usual.items():
        if signal.getsignal(number) is signal.SIG_IGN:
            signal.signal(number, handler)
    if config.getoption("--deep"):
        settings.load_profile("deep")


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    _group(items)
    wanted = _is_deep if config.getoption("--deep") else _is_in_suite
    items[:] = filter(wanted, items)


def pytest_collection_finish(session: pytest.Session) -> None:
    """Restore ctrl+c, which dask_jobqueue replaces when a test module imports it.

    The garbage collector passes over the modules, and runs less often.
    """
    signal.signal(signal.SIGINT, signal.default_int_handler)
    gc.collect()
    gc.freeze()
    atexit.register(gc.unfreeze)
    gc.set_threshold(20_000, 20, 20)


def _is_deep(item: pytest.Item) -> bool:
    return not _is_in_suite(item) or is_hypothesis_test(getattr(item, "obj", None))


def _is_in_suite(item: pytest.Item) -> bool:
    return item.get_closest_marker("deep") is None


def _group(items: list[pytest.Item]) -> None:
    """One process runs all tests of a file, or of a folder named above."""
    tests_folder = Path(__file__).parent
    for item in items:
        if item.get_closest_marker("xdist_group") is None:
            path = item.path.relative_to(tests_folder)
            folder = path.parts[0]
            name = folder if folder in FOLDERS_OF_ONE_PROCESS else str(path)
            item.add_marker(pytest.mark.xdist_group(name))


@pytest.fixture(autouse=True, scope="session")
def fast_replacements(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Replace what only takes time: the compilation of umap-learn, and waiting for the disk.

    Processes that tests start find the replacement of umap-learn by PYTHONPATH.
    """
    folder = tmp_path_factory.mktemp("modules")
    shutil.copy(linear_umap.__file__, folder / "umap.py")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(folder), prepend=os.pathsep)
        patch.setitem(sys.modules, "umap", linear_umap)
        patch.setattr(os, "fsync", lambda descriptor: None)
        yield


@pytest.fixture
def real_umap(monkeypatch: pytest.MonkeyPatch) -> None:
    """Use umap-learn, which compiles its functions at the first import on a machine."""
    monkeypatch.delitem(sys.modules, "umap")


@pytest.fixture(autouse=True)
def user_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A separate folder per test for the user's selections, notes and tags."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "share"))
    return tmp_path / "share" / "s2rtui"


@pytest.fixture
def s2r(capsys: pytest.CaptureFixture[str]) -> RunCommand:
    """Call `s2r("verify", path)` to run the command in this process; gives code and outputs."""
    return partial(run_command, capsys)


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


Build = Callable[[Path], object]
"""Writes a file or folder at the given path, which does not exist."""


@pytest.fixture(scope="session")
def build_once(
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Callable[[str, Build], Path]]:
    """Call `build_once(name, build)` to build something once for all processes of the session.

    The first caller builds it, the others wait. No test modifies what is built. Stores stay open.
    """
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "built"
    folder.mkdir(exist_ok=True)

    def get(name: str, build: Build) -> Path:
        path, is_built = folder / name, folder / f"{name}.built"
        with FileLock(folder / f"{name}.lock"):
            if not is_built.exists():
                build(path)
                is_built.touch()
        if path.suffix == ".s2r" and name not in kept:
            kept.add(name)
            stack.enter_context(kept_open(path))
        return path

    kept: set[str] = set()
    with ExitStack() as stack:
        yield get


BuildOnce = Callable[[str, Build], Path]


@pytest.fixture(scope="session")
def tiny_store(build_once: BuildOnce) -> Path:
    """A synthetic store that no test modifies."""
    return build_once("tiny.s2r", tiny.build)


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
def trained_store(build_once: BuildOnce) -> Path:
    """A store of 40 pairs in two shards with a briefly trained model and no computed run."""
    return build_once("trained.s2r", _train)


def _train(path: Path, pairs_count: int = 40) -> None:
    from tests.support.small_stores import build_small

    build_small(path, pairs_count, size=64, steps=3)


@pytest.fixture(scope="session")
def computed_store(trained_store: Path, build_once: BuildOnce) -> Path:
    """The trained store with all heatmaps of `vanilla`, and runs of it without heatmaps.

    The real images of `black` are black, those of `bright` are brightened.
    """
    return build_once("computed.s2r", lambda path: _compute(trained_store, path))


def _compute(trained: Path, path: Path) -> None:
    from s2rtools.adjustments import parse_adjustment
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtools.precompute.run_registration import add_run
    from tests.support.silent_reporter import SilentReporter

    copy_store(trained, path)
    add_run(path, "black", "vanilla", None, None, parse_adjustment("real:black"))
    add_run(path, "bright", "vanilla", None, None, parse_adjustment("real:brightness=1.15"))
    assert precompute(path, SilentReporter(), ["vanilla"]) == ["vanilla"]
    runs = ["black", "bright"]
    assert precompute(path, SilentReporter(), runs, PrecomputeOptions(())) == runs


@pytest.fixture(scope="session")
def few_pairs_store(build_once: BuildOnce) -> Path:
    """A store of 8 pairs whose run `vanilla` of a briefly trained model has one kind of heatmap."""
    return build_once("few.s2r", _compute_few)


def _compute_few(path: Path) -> None:
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from tests.support.silent_reporter import SilentReporter

    _train(path, 8)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(("feature_distance",)))


@pytest.fixture(scope="session")
def objects_world(build_once: BuildOnce) -> Path:
    """A small world whose sides differ by objects alone, with one run; no test modifies it."""
    kinds = ("pixel_difference", "harmonised_difference", "harmonised_distance", "harm")
    return build_once("objects.s2r", lambda path: make_world(path, "objects", 6, kinds))


def make_world(path: Path, factors: str, count: int, kinds: tuple[str, ...]) -> None:
    """`count` instances of each trajectory of 64 x 64 pixels, and run `vanilla` with `kinds`."""
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtools.training import pretrained
    from s2rtui.cli import main
    from tests.support.silent_reporter import SilentReporter

    options = ["--instances", str(count), "--size", "64", "--factors", factors]
    assert main(["ingest", "world", *options, "--store", str(path)]) == 0
    pretrained.add_pretrained_models(path)
    precompute(path, SilentReporter(), ["vanilla"], PrecomputeOptions(kinds))


@pytest.fixture(scope="session")
def moved_camera_store(build_once: BuildOnce) -> Path:
    """A small default world with runs of one model whose cameras are moved.

    Run `zero` sets all adjustments to 0, `up` raises the sim camera and brightens its images,
    `low` lowers the real camera; all runs are computed.
    """
    return build_once("moved.s2r", _move_cameras)


def _move_cameras(path: Path) -> None:
    from s2rtools.precompute.pipeline import PrecomputeOptions, precompute
    from s2rtools.training import pretrained
    from s2rtui.cli import main
    from tests.support.silent_reporter import SilentReporter

    store = ["--store", str(path)]
    assert main(["ingest", "world", "--instances", "4", *store]) == 0
    pretrained.add_pretrained_models(path)
    moves = {
        "zero": "sim:camera_height=0,camera_pitch=0,camera_fov=0",
        "up": "sim:camera_height=0.1,brightness=1.2,camera_pitch=-5,camera_fov=6",
        "low": "real:camera_height=-0.1,camera_fov=-4",
    }
    for name, chain in moves.items():
        assert main(["run", "add", name, "--model", "vanilla", "--adjust", chain, *store]) == 0
    kinds = ("feature_distance", "pixel_difference", "harmonised_distance")
    precompute(path, SilentReporter(), ["vanilla", *moves], PrecomputeOptions(kinds))
