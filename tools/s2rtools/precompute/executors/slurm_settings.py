"""The settings of SLURM jobs that compute units: a TOML file."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import msgspec

from s2rstore.errors import RequestError
from s2rstore.files.documents import read_toml
from s2rstore.files.input_files import read_text

_Positive = Annotated[int, msgspec.Meta(ge=1, le=10_000)]
_TIME = re.compile(r"(?:(\d+)-)?(\d+):(\d\d)(?::(\d\d))?")
_LARGEST_SCRIPT = 65_536
_EXPECTED = "name a TOML file with a table [slurm]"


class SlurmSettings(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True
):
    """One job runs one worker; `cores` are the threads with which it computes.

    `walltime` is as `sbatch --time` takes it. `directives` are further lines `#SBATCH`, `skip`
    drops lines that contain one of its texts, `prologue` are lines of shell before the worker
    starts. `script` is a file that replaces the whole job script; its line with the command of a
    Dask worker is replaced by that of each worker. `store` is the folder of the store on the nodes,
    if it is another one than here, `shared_folder` one that all of them see, for the certificates.
    `host` and `port` are where the scheduler listens on this machine, `interface` the network that
    both sides use.
    """

    jobs: _Positive
    cores: _Positive = 1
    memory: str = "4GB"
    walltime: str = "01:00:00"
    queue: str | None = None
    account: str | None = None
    directives: list[str] = []
    skip: list[str] = []
    prologue: list[str] = []
    script: str | None = None
    python: str = sys.executable
    log_folder: str | None = None
    local_folder: str | None = None
    shared_folder: str = "~"
    store: str | None = None
    interface: str | None = None
    host: str | None = None
    port: Annotated[int, msgspec.Meta(ge=0, le=65_535)] = 0
    file: str = ""

    def job_options(self) -> dict[str, Any]:
        """The options of `dask_jobqueue.SLURMCluster` that describe a job."""
        seconds, log_folder = self.seconds(), self.log_folder
        if self.log_folder is not None:
            log_folder = str(Path(self.log_folder).expanduser())
        return {
            "cores": self.cores,
            "processes": 1,
            "memory": self.memory,
            "walltime": self.walltime,
            "queue": self.queue,
            "account": self.account,
            "job_name": "s2r-worker",
            "python": shlex.quote(self.python),
            "job_extra_directives": list(self.directives),
            "job_directives_skip": list(self.skip),
            "job_script_prologue": [*_ENVIRONMENT, *self.prologue],
            "log_directory": log_folder,
            "local_directory": self.local_folder or "${TMPDIR:-/tmp}",
            "interface": self.interface,
            "death_timeout": 60,
            "worker_extra_args": [
                "--no-dashboard", "--dashboard-address", "127.0.0.1:0",
                # A worker ends by itself, with its unit finished, before SLURM ends the job.
                "--lifetime", f"{max(1, int(0.92 * seconds))}s",
                "--lifetime-stagger", f"{int(0.06 * seconds)}s",
            ],
        }  # fmt: skip

    def own_script(self) -> str | None:
        """The job script of the user; None where there is none.

        Raises RequestError for a file that cannot be read or has no line for the worker.
        """
        if self.script is None:
            return None
        path = Path(self.file).parent / Path(self.script).expanduser()
        try:
            text = read_text(path, _LARGEST_SCRIPT)
        except RequestError as error:
            raise RequestError(f"{self.file}: script {error}") from error
        if sum(WORKER_MODULE in line for line in text.splitlines()) != 1:
            raise RequestError(f"{path}: needs one line with {WORKER_MODULE}, as printed")
        return text

    def scheduler_options(self) -> dict[str, Any]:
        options: dict[str, Any] = {"port": self.port}
        if self.host is not None:
            options["host"] = self.host
        return options

    def seconds(self) -> int:
        """The wall time in seconds."""
        match = _TIME.fullmatch(self.walltime)
        if match is None:
            raise RequestError(
                f"{self.file}: walltime {self.walltime!r}: write it as hh:mm:ss or days-hh:mm:ss"
            )
        days, hours, minutes, seconds = (int(part or 0) for part in match.groups())
        return ((24 * days + hours) * 60 + minutes) * 60 + seconds


WORKER_MODULE = "distributed.cli.dask_worker"

_ENVIRONMENT = (
    "export DASK_DISTRIBUTED__WORKER__MEMORY__TARGET=False",
    "export DASK_DISTRIBUTED__WORKER__MEMORY__SPILL=False",
    "export DASK_DISTRIBUTED__WORKER__MEMORY__PAUSE=False",
    "export DASK_DISTRIBUTED__WORKER__MEMORY__TERMINATE=0.95",
    "export DASK_DISTRIBUTED__WORKER__HTTP__ROUTES='[]'",
    "export OMP_WAIT_POLICY=PASSIVE GOMP_SPINCOUNT=0",
    "export MALLOC_ARENA_MAX=1 DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False",
)


def read_settings(path: Path) -> SlurmSettings:
    """Read a file with a table [slurm]. Raises RequestError that names what is wrong in it."""
    try:
        table = read_toml(path).get("slurm")
    except RequestError as error:
        raise RequestError(f"--cluster {error}; {_EXPECTED}") from error
    if not isinstance(table, dict):
        raise RequestError(f"--cluster {path}: has no table [slurm]; {_EXPECTED}")
    try:
        settings = msgspec.convert(table, SlurmSettings)
    except msgspec.ValidationError as error:
        raise RequestError(f"{path}: {error}") from error
    if settings.file:
        raise RequestError(f"{path}: object contains unknown field `file`")
    expanded = str(Path(settings.shared_folder).expanduser())
    settings = msgspec.structs.replace(settings, file=str(path), shared_folder=expanded)
    settings.seconds()
    settings.own_script()
    return settings


def with_worker(script: str, command: str) -> str:
    """A job script of the user with the command of a worker in the place of the printed one."""
    lines = (command if WORKER_MODULE in line else line for line in script.splitlines())
    return "\n".join([*lines, ""])
