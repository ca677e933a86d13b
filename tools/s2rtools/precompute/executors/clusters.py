"""Connect to workers of a Dask cluster, or start them: on this machine, or as jobs of SLURM."""

from __future__ import annotations

import logging
import re
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.security import working_folder
from s2rtools.precompute.executors.executor import Executor
from s2rtools.precompute.executors.local_executors import (
    defer_interrupts,
    start_resource_tracker,
    usual_threads,
)
from s2rtools.precompute.executors.slurm_settings import SlurmSettings, read_settings, with_worker

ReportLine = Callable[[str], None]

_LOCAL = re.compile(r"local:([1-9]\d{0,3})")
_CONNECT_SECONDS = 20
_NO_DASHBOARD = "127.0.0.1:0"
"""Dask's HTTP servers cannot be left out; this one is reached from this machine only."""
_CONFIG = {
    # torch keeps memory that Dask does not know of: such a worker would be paused for ever.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.worker.daemon": True,
    # A unit that ends its worker is recognised by the executor, which sees single workers.
    "distributed.scheduler.allowed-failures": 20,
    # No page shows or changes anything of a cluster.
    "distributed.scheduler.http.routes": [],
    "distributed.worker.http.routes": [],
    # Compiled code may hold the interpreter lock, and so the heartbeat.
    "distributed.scheduler.worker-ttl": "10 minutes",
}


@contextmanager
def open_cluster(
    cluster: str | None, scheduler: str | None, threads: int | None, report_line: ReportLine
) -> Iterator[Executor]:
    """An executor of `cluster`, as `local:4` or a file of SLURM settings, or of a `scheduler`.

    Workers that are started here end with the context. Raises RequestError for invalid names or
    settings, without the extra [cluster], and where no scheduler answers.
    """
    _require_extra()
    import dask

    for name in ("distributed", "tornado", "asyncio", "dask_jobqueue"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set(_CONFIG), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if scheduler is not None:
            opened = _scheduler(scheduler, report_line)
        elif match := _LOCAL.fullmatch(cluster or ""):
            opened = _local(int(match[1]), threads, report_line)
        else:
            opened = _slurm(read_settings(Path(cluster or "")), report_line)
        with opened as executor:
            yield executor


def job_script(cluster: str) -> str:
    """The script of one job that `cluster`, a file of SLURM settings, would submit."""
    _require_extra()
    if _LOCAL.fullmatch(cluster):
        raise RequestError(f"--cluster {cluster}: has no job script; name a file of SLURM settings")
    settings = read_settings(Path(cluster))
    job = _job_class(settings)("tls://SCHEDULER:PORT", name="NAME", **settings.job_options())
    return str(job.job_script())


def _job_class(settings: SlurmSettings) -> Any:
    from dask_jobqueue.slurm import SLURMJob

    script = settings.own_script()
    if script is None:
        return SLURMJob
    own: str = script

    class ScriptedJob(SLURMJob):
        """A job with the user's script."""

        def job_script(self) -> str:
            return with_worker(own, self._command_template)

    return ScriptedJob


@contextmanager
def _scheduler(address: str, report_line: ReportLine) -> Iterator[Executor]:
    from distributed import Client

    from s2rtools.precompute.executors.dask_executor import DaskExecutor

    try:
        client = Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        message = f"--scheduler {address}: no scheduler answers there ({error})"
        raise RequestError(message) from error
    with client:
        yield DaskExecutor(client, report_line)


@contextmanager
def _local(workers: int, threads: int | None, report_line: ReportLine) -> Iterator[Executor]:
    from distributed import Client, LocalCluster, Security

    from s2rtools.precompute.executors.dask_executor import DaskExecutor

    working_folder.distrust()
    start_resource_tracker()
    with ExitStack() as stack:
        with defer_interrupts():  # ctrl+c reaches this process only, which ends the workers
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=workers, threads_per_worker=threads or usual_threads(workers),
                    processes=True, host="127.0.0.1", dashboard_address=_NO_DASHBOARD,
                    worker_dashboard_address=_NO_DASHBOARD, security=Security.temporary(),
                    protocol="tls://", memory_limit=None, silence_logs=logging.CRITICAL,
                )
            )  # fmt: skip
        client = stack.enter_context(Client(cluster, set_as_default=False))
        yield DaskExecutor(client, report_line, expected=workers)


@contextmanager
def _slurm(settings: SlurmSettings, report_line: ReportLine) -> Iterator[Executor]:
    from dask_jobqueue import SLURMCluster
    from distributed import Client

    from s2rtools.precompute.executors.dask_executor import DaskExecutor

    options: dict[str, Any] = {"dashboard_address": _NO_DASHBOARD, **settings.scheduler_options()}
    with ExitStack() as stack:
        try:
            folder = tempfile.TemporaryDirectory(dir=settings.shared_folder, prefix=".s2r-tls-")
            security = _security_in(Path(stack.enter_context(folder)))
            cluster = stack.enter_context(
                SLURMCluster(
                    security=security, protocol="tls://", silence_logs="critical",
                    scheduler_options=options, job_cls=_job_class(settings),
                    **settings.job_options(),
                )
            )  # fmt: skip
        except (OSError, RuntimeError, ValueError) as error:
            raise RequestError(f"{settings.file}: no cluster could be started ({error})") from error
        report_line(
            f"{settings.jobs} SLURM job(s) submitted; the scheduler is {cluster.scheduler_address}"
        )
        cluster.adapt(minimum_jobs=settings.jobs, maximum_jobs=settings.jobs)
        client = stack.enter_context(Client(cluster, set_as_default=False))
        root = None if settings.store is None else Path(settings.store)
        yield DaskExecutor(client, report_line, settings.jobs, root)


def _security_in(folder: Path) -> Any:
    """New certificates, as files that only this user can read."""
    from distributed import Security

    created = Security.temporary().get_tls_config_for_role("worker")
    files = {}
    for name in ("ca_file", "cert", "key"):
        path = folder / f"{name}.pem"
        path.touch(mode=0o600)
        path.write_text(created[name])
        files[name] = str(path)
    roles = {
        f"tls_{role}_{name}": files[name]
        for role in ("client", "scheduler", "worker")
        for name in ("cert", "key")
    }
    return Security(require_encryption=True, tls_ca_file=files["ca_file"], **roles)


def _require_extra() -> None:
    try:
        import cryptography  # noqa: F401
        import dask_jobqueue  # noqa: F401
        import distributed  # noqa: F401
    except ImportError as error:
        raise RequestError(
            f"{error.name} is not installed; `pip install 's2rtui[tools,cluster]'` installs it"
        ) from error
