"""Precompute in the jobs of a real SLURM with two nodes, each with its own mount of the store."""

import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from bench.support.processes import wait_until
from s2rstore.files.ledger import Ledger
from s2rstore.maintenance.verify import verify
from tests.cluster.slurm_machine import SlurmMachine, missing_program, slurm_machine

pytest.importorskip("dask_jobqueue")
_MISSING = missing_program()
pytestmark = [
    pytest.mark.xdist_group("cluster"),
    pytest.mark.skipif(_MISSING is not None, reason=f"SLURM cannot be started: no {_MISSING}"),
]
_SETTINGS = """
[slurm]
jobs = 2
memory = "2GB"
walltime = "00:20:00"
host = "127.0.0.1"
shared_folder = "{folder}"
log_folder = "{folder}/logs"
store = "{mount}/{store}"
prologue = [
    "export DASK_DISTRIBUTED__WORKER__PRELOAD='[\\"tests.cluster.worker_preload\\"]'",
    "export S2R_TEST_UNIT_SECONDS={seconds} S2R_TEST_GATE={gate}",
]
"""
_SECONDS = 240


@pytest.fixture(scope="module")
def stores(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of all stores; on the nodes it has another path."""
    return tmp_path_factory.mktemp("slurm")


@pytest.fixture(scope="module")
def slurm(stores: Path) -> Iterator[SlurmMachine]:
    mount = stores / "mount"
    mount.mkdir()
    with slurm_machine(stores / "slurm", lambda node: f"mount --bind {stores} {mount}") as machine:
        yield machine


@pytest.fixture(scope="module")
def serial(slurm: SlurmMachine, stores: Path, trained_store: Path) -> Path:
    """The run as one process computes it."""
    path = Path(shutil.copytree(trained_store, stores / "serial.s2r"))
    command = _command(path, "--workers", "1", "--threads", "1")
    subprocess.run(command, env=slurm.environment, check=True, timeout=_SECONDS)
    return path


def _command(path: Path, *arguments: str) -> list[str]:
    command = [sys.executable, "-m", "tests.cluster.small_units", "precompute", str(path)]
    return [*command, "--kinds", "feature_distance", "--backend", "torch", *arguments]


class Precompute:
    """A precompute of a copy of the store in SLURM jobs."""

    def __init__(self, slurm: SlurmMachine, stores: Path, store: Path) -> None:
        self.path, self._folder, self._slurm = store, stores, slurm
        self.log = stores / f"{store.stem}.log"

    def start(self, seconds: float = 0.0, gate: str = "") -> subprocess.Popen[bytes]:
        settings = self._folder / f"{self.path.stem}.toml"
        text = _SETTINGS.format(
            folder=self._folder, mount=self._folder / "mount", store=self.path.name,
            seconds=seconds, gate=gate,
        )  # fmt: skip
        settings.write_text(text)
        command = _command(self.path, "--cluster", str(settings))
        with self.log.open("wb") as log:
            return subprocess.Popen(command, env=self._slurm.environment, stdout=log, stderr=log)

    def finish(self, process: subprocess.Popen[bytes]) -> tuple[int, str]:
        return process.wait(_SECONDS), self.log.read_text()

    def received(self) -> set[Path]:
        return {path for path in (self.path / "units").rglob("*") if path.name.isdigit()}

    def wait_for_units(self, count: int, process: subprocess.Popen[bytes]) -> None:
        def is_there() -> bool:
            return len(self.received()) >= count or process.poll() is not None

        assert wait_until(is_there, _SECONDS), self.log.read_text()
        assert process.poll() is None, self.log.read_text()


@pytest.fixture
def precompute(
    slurm: SlurmMachine, stores: Path, trained_store: Path, request: pytest.FixtureRequest
) -> Precompute:
    name = request.node.name.removeprefix("test_")[:24]
    path = Path(shutil.copytree(trained_store, stores / f"{name}.s2r"))
    return Precompute(slurm, stores, path)


def _assert_complete(path: Path, serial: Path) -> None:
    assert verify(path) == []
    assert _shards(path) == _shards(serial)
    assert not list((path / "units").iterdir())


def _shards(path: Path) -> dict[str, str]:
    """The checksum of every computed file, as the ledger states it."""
    ledger = Ledger(path).by_path()
    return {
        name: entry.checksum
        for name, entries in ledger.items() for entry in entries
        if name.startswith("runs.zarr")
    }  # fmt: skip


def test_a_cancelled_job(precompute, slurm, serial, stores):
    gate = stores / "gate"
    gate.mkdir()
    process = precompute.start(gate=str(gate))
    assert wait_until(lambda: len(list(gate.iterdir())) == 2, _SECONDS), precompute.log.read_text()
    jobs = slurm.jobs()
    assert sorted(jobs.values()) in (["n1", "n1"], ["n1", "n2"], ["n2", "n2"])
    slurm.call("scancel", "--signal=KILL", "--full", next(iter(jobs)))
    (gate / "open").touch()
    code, log = precompute.finish(process)
    assert code == 0, log
    assert "was lost; " in log
    assert "published" in log
    _assert_complete(precompute.path, serial)
    assert wait_until(lambda: not slurm.jobs(), 30)


@pytest.mark.deep
def test_a_killed_driver(precompute, slurm, serial):
    process = precompute.start(seconds=0.3)
    precompute.wait_for_units(3, process)
    process.send_signal(signal.SIGKILL)
    process.wait()
    received = {path: path.stat().st_mtime_ns for path in precompute.received()}
    assert len(received) >= 3
    assert verify(precompute.path) == []
    code, log = precompute.finish(precompute.start())
    assert code == 0, log
    left = 40 - 4 * len(received)
    assert f"vanilla: forward: {left}/{left}, " in log
    _assert_complete(precompute.path, serial)
