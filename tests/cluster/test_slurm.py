"""Precompute in the jobs of a real SLURM with two nodes, each with its own mount of the store."""

import shutil
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
    "export S2R_TEST_GATE={gate}",
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


def _shards(path: Path) -> dict[str, str]:
    """The checksum of every computed file, as the ledger states it."""
    ledger = Ledger(path).by_path()
    return {
        name: entry.checksum
        for name, entries in ledger.items() for entry in entries
        if name.startswith("runs.zarr")
    }  # fmt: skip


def test_a_cancelled_job(slurm, serial, stores, trained_store):
    path = Path(shutil.copytree(trained_store, stores / "cancelled.s2r"))
    gate, settings, log = (stores / name for name in ("gate", "slurm.toml", "precompute.log"))
    gate.mkdir()
    settings.write_text(
        _SETTINGS.format(folder=stores, mount=stores / "mount", store=path.name, gate=gate)
    )
    command = _command(path, "--cluster", str(settings))
    with log.open("wb") as out:
        process = subprocess.Popen(command, env=slurm.environment, stdout=out, stderr=out)
    assert wait_until(lambda: len(list(gate.iterdir())) == 2, _SECONDS), log.read_text()
    jobs = slurm.jobs()
    assert sorted(jobs.values()) in (["n1", "n1"], ["n1", "n2"], ["n2", "n2"])
    slurm.call("scancel", "--signal=KILL", "--full", next(iter(jobs)))
    (gate / "open").touch()
    assert process.wait(_SECONDS) == 0, log.read_text()
    assert "was lost" in log.read_text()
    assert "published" in log.read_text()
    assert verify(path) == []
    assert _shards(path) == _shards(serial)
    assert not list((path / "units").iterdir())
    assert wait_until(lambda: not slurm.jobs(), 30)
