"""Jobs that SLURM accepts or refuses, with programs that answer as `sbatch` does."""

import subprocess
import sys
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rtools.precompute.executors.clusters import open_cluster
from s2rtools.precompute.executors.executor import Task
from tests.cluster.counted_units import CountedComputation, plan_of, stage_of

pytest.importorskip("dask_jobqueue")

_REFUSED = "sbatch: error: Batch job submission failed: Invalid account"
_SETTINGS = """
[slurm]
jobs = {jobs}
account = "nobody"
host = "127.0.0.1"
shared_folder = "{folder}"
"""


class Sbatch:
    """A program `sbatch` that accepts some jobs and refuses the others."""

    def __init__(self, folder: Path, accepted: int) -> None:
        self.calls = folder / "calls"
        self._folder = folder / "bin"
        self._folder.mkdir()
        places = " ".join(str(folder / f"job{number}") for number in range(accepted))
        self._write(
            "sbatch",
            f"echo >> {self.calls}\n"
            f"for place in {places}; do mkdir $place 2> /dev/null && echo 7 && exit; done\n"
            f"echo '{_REFUSED}' >&2\nexit 1",
        )
        self._write("scancel", "exit 0")

    def _write(self, name: str, script: str) -> None:
        file = self._folder / name
        file.write_text(f"#!/bin/sh\nPATH=/usr/bin:/bin\n{script}\n")
        file.chmod(0o755)

    def settings(self, jobs: int, monkeypatch: pytest.MonkeyPatch) -> str:
        """A file of settings of so many jobs, which this program submits."""
        monkeypatch.setenv("PATH", str(self._folder))
        file = self._folder.parent / "slurm.toml"
        file.write_text(_SETTINGS.format(jobs=jobs, folder=self._folder.parent))
        return str(file)


def tasks_in(root: Path) -> list[Task]:
    plan = plan_of(root, stage_of("x"))
    return [Task(CountedComputation(root), unit) for unit in plan.units]


def test_a_refused_submission_is_told_with_the_words_of_sbatch(tmp_path, monkeypatch):
    settings = Sbatch(tmp_path, accepted=0).settings(2, monkeypatch)
    lines: list[str] = []
    with (
        open_cluster(settings, None, None, lines.append) as executor,
        pytest.raises(RequestError) as error,
    ):
        list(executor.run(tasks_in(tmp_path / "s.s2r")))
    assert str(error.value) == f"{settings}: no job could be submitted ({_REFUSED})"
    assert lines == []


def test_a_missing_sbatch_is_told(tmp_path, monkeypatch):
    settings = Sbatch(tmp_path, accepted=0).settings(1, monkeypatch)
    (tmp_path / "bin" / "sbatch").unlink()
    with (
        open_cluster(settings, None, None, print) as executor,
        pytest.raises(RequestError, match=r"no job could be submitted .*No such file.*'sbatch'"),
    ):
        list(executor.run(tasks_in(tmp_path / "s.s2r")))


class SeenError(Exception):
    """Ends a run that waits for workers."""


def test_only_accepted_jobs_are_told_as_submitted(tmp_path, monkeypatch):
    settings = Sbatch(tmp_path, accepted=1).settings(3, monkeypatch)
    lines: list[str] = []

    def report_line(line: str) -> None:
        lines.append(line)
        if line.startswith("waiting"):
            raise SeenError

    with open_cluster(settings, None, None, report_line) as executor, pytest.raises(SeenError):
        list(executor.run(tasks_in(tmp_path / "s.s2r")))
    assert lines[0].startswith("1 SLURM job(s) submitted; the scheduler is tls://127.0.0.1:")
    assert lines[1:] == [f"2 of 3 jobs were refused ({_REFUSED})", "waiting for 1 workers to start"]


@pytest.mark.parametrize("cluster", ["slurm", "local:2"])
def test_nothing_is_started_where_nothing_is_to_be_computed(tmp_path, monkeypatch, cluster):
    sbatch = Sbatch(tmp_path, accepted=2)
    settings = sbatch.settings(2, monkeypatch)
    monkeypatch.setattr("distributed.deploy.SpecCluster.__init__", None)
    lines: list[str] = []
    name = settings if cluster == "slurm" else cluster
    with open_cluster(name, None, 1, lines.append) as executor:
        assert list(executor.run([])) == []
    assert lines == []
    assert not sbatch.calls.exists()


def test_ctrl_c_stays_as_it_was():
    """dask_jobqueue makes it end the process with 0 as soon as it is imported."""
    program = (
        "import signal\n"
        "from s2rtools.precompute.executors.clusters import open_cluster\n"
        "before = signal.getsignal(signal.SIGINT)\n"
        "with open_cluster('local:1', None, None, print):\n"
        "    assert signal.getsignal(signal.SIGINT) is before\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=300)
