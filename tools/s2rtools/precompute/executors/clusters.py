"""Connect to workers of a Dask cluster, or start them: on this machine, or as jobs of SLURM."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import re
import signal
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from s2rstore.errors import RequestError, first_line
from s2rstore.security import working_folder
from s2rtools.precompute.executors.executor import Executor, RequestedWorkers, Task, by_threads
from s2rtools.precompute.executors.local_executors import (
    default_threads,
    defer_interrupts,
    start_resource_tracker,
)
from s2rtools.precompute.executors.slurm_settings import SlurmSettings, read_settings
from s2rtools.precompute.unit_results import Receipt

ReportLine = Callable[[str], None]

_LOCAL = re.compile(r"local:([1-9]\d{0,3})")
_CONNECT_SECONDS, _ANSWER_SECONDS = 20, 5
_NO_DASHBOARD = "127.0.0.1:0"
"""Dask's HTTP servers cannot be left out; this one is reached from this machine only."""
_CONFIG = {
    # torch keeps memory that Dask does not know of: such a worker would be paused for ever.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.worker.daemon": True,
    # Units are computed 7 % faster if all threads share one memory arena, which keeps the pages of
    # large arrays, and if Dask does not sample the stacks of the threads.
    "distributed.nanny.pre-spawn-environ.MALLOC_ARENA_MAX": "1",
    "distributed.worker.profile.enabled": False,
    # The executor computes a unit alone after that.
    "distributed.scheduler.allowed-failures": 1,
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

    Workers are started for the first task, and end with the context. Raises RequestError for
    invalid names or settings, without the extra [cluster], and where no scheduler answers.
    """
    require_extra()
    import dask

    for name in ("distributed", "tornado", "asyncio", "dask_jobqueue"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    with dask.config.set(_CONFIG), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if scheduler is not None:
            with _scheduler(scheduler, report_line) as executor:
                yield executor
            return
        count = local_workers(cluster or "")
        with ExitStack() as stack:
            if count is not None:
                start = partial(_local, report_line, count)
                yield _Started(start, threads, default_threads(count), stack)
            else:
                settings = read_settings(Path(cluster or ""))
                start = partial(_slurm, report_line, settings)
                yield _Started(start, settings.cores, settings.cores, stack)


def local_workers(cluster: str) -> int | None:
    """The number of workers that `local:N` names; None where `cluster` is a file of settings.

    Raises RequestError for another number.
    """
    if not cluster.startswith("local:"):
        return None
    match = _LOCAL.fullmatch(cluster)
    if match is None:
        raise RequestError(f"--cluster {cluster}: use local:N, with 1 to 9999 workers")
    return int(match[1])


class _Started:
    """The executor of a cluster that is started for the first task, and ends with `stack`.

    `start` starts workers with some threads each, again where other tasks need another number.
    `threads` are those that are requested; without, an array that is begun keeps its own, and
    others get the `usual` ones.
    """

    is_remote = True

    def __init__(
        self,
        start: Callable[[int], AbstractContextManager[Executor]],
        threads: int | None,
        usual: int,
        stack: ExitStack,
    ) -> None:
        self._start, self._threads, self._usual = start, threads, usual
        self._stack = stack.enter_context(ExitStack())
        self._started: tuple[int, Executor] | None = None

    def run(self, tasks: Iterable[Task]) -> Iterator[Receipt]:
        """See `Executor`. Raises RequestError where the cluster cannot be started, too."""
        for threads, some in by_threads(tasks, self._threads, self._usual).items():
            if self._started is None or self._started[0] != threads:
                self._started = None
                self._stack.close()
                self._started = threads, self._stack.enter_context(self._start(threads))
            yield from self._started[1].run(some)


def job_script(cluster: str) -> str:
    """The script of one job that `cluster`, a file of SLURM settings, would submit."""
    require_extra()
    from s2rtools.precompute.executors.slurm_jobs import job_class

    if local_workers(cluster) is not None:
        raise RequestError(f"--cluster {cluster}: has no job script; name a file of SLURM settings")
    settings = read_settings(Path(cluster))
    job = job_class(settings)("tls://SCHEDULER:PORT", name="NAME", **settings.job_options())
    return str(job.job_script())


@contextmanager
def _scheduler(address: str, report_line: ReportLine) -> Iterator[Executor]:
    from distributed import Client

    from s2rtools.precompute.executors.dask_executor import DaskExecutor

    _require_scheduler(address)
    try:
        client = Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        message = f"--scheduler {address}: no scheduler answers there ({first_line(error)})"
        raise RequestError(message) from error
    with client:
        if not _is_protected(address):
            report_line(
                f"warning: --scheduler {address}: not encrypted; whoever reaches it can run code "
                "here and on the workers; use tls://, or a network that you trust"
            )
        yield DaskExecutor(client, report_line)


def _require_scheduler(address: str) -> None:
    """Raise RequestError unless something at `address` answers as Dask does."""
    from distributed import Security
    from distributed.comm import connect

    where = f"--scheduler {address}"

    async def greet() -> None:
        options = Security().get_connection_args("client")
        comm = await asyncio.wait_for(connect(address, timeout=3, **options), _ANSWER_SECONDS)
        comm.abort()

    try:
        asyncio.run(greet())
    except TimeoutError as error:
        raise RequestError(
            f"{where}: no Dask scheduler answers there within {_ANSWER_SECONDS} s; check host and "
            "port, and use tls:// where the scheduler does"
        ) from error
    except Exception as error:  # what another program answers may be taken for anything
        reason = first_line(error)[:200]
        raise RequestError(f"{where}: no Dask scheduler answers there ({reason})") from error


def _is_protected(address: str) -> bool:
    """Whether a scheduler is reached by TLS, or on this machine."""
    protocol, separator, rest = address.rpartition("://")
    if separator and protocol in ("tls", "wss"):
        return True
    host = urlsplit(f"//{rest}").hostname or ""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


@contextmanager
def _local(report_line: ReportLine, workers: int, threads: int) -> Iterator[Executor]:
    from distributed import Client, LocalCluster, Security

    from s2rtools.precompute.executors.dask_executor import DaskExecutor

    working_folder.distrust()
    start_resource_tracker()
    with ExitStack() as stack:
        with defer_interrupts():  # ctrl+c reaches this process only, which ends the workers
            cluster = stack.enter_context(
                LocalCluster(
                    n_workers=workers, threads_per_worker=threads,
                    processes=True, host="127.0.0.1", dashboard_address=_NO_DASHBOARD,
                    worker_dashboard_address=_NO_DASHBOARD, security=Security.temporary(),
                    protocol="tls://", memory_limit=None, silence_logs=logging.CRITICAL,
                )
            )  # fmt: skip
        client = stack.enter_context(Client(cluster, set_as_default=False))
        yield DaskExecutor(client, report_line, RequestedWorkers(workers))


@contextmanager
def _slurm(report_line: ReportLine, settings: SlurmSettings, threads: int) -> Iterator[Executor]:
    """`threads` are the cores of the settings."""
    from dask_jobqueue import SLURMCluster
    from distributed import Client

    from s2rtools.precompute.executors.dask_executor import DaskExecutor
    from s2rtools.precompute.executors.slurm_jobs import Submissions

    submissions = Submissions(settings)
    options: dict[str, Any] = {"dashboard_address": _NO_DASHBOARD, **settings.scheduler_options()}
    with ExitStack() as stack:
        try:
            folder = tempfile.TemporaryDirectory(dir=settings.shared_folder, prefix=".s2r-tls-")
            security = _security_in(Path(stack.enter_context(folder)))
            cluster = stack.enter_context(
                SLURMCluster(
                    security=security, protocol="tls://", silence_logs="critical",
                    scheduler_options=options, job_cls=submissions.job_class(),
                    **settings.job_options(),
                )
            )  # fmt: skip
        except (OSError, RuntimeError, ValueError) as error:
            raise RequestError(f"{settings.file}: no cluster could be started ({error})") from error
        count = submissions.submit(cluster)
        report_line(f"{count} SLURM job(s) submitted; the scheduler is {cluster.scheduler_address}")
        client = stack.enter_context(Client(cluster, set_as_default=False))
        root = None if settings.store is None else Path(settings.store)
        yield DaskExecutor(client, report_line, submissions.workers, root)


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


def require_extra() -> None:
    """Import the libraries of the extra [cluster], and keep what ctrl+c does.

    dask_jobqueue replaces it when it is imported. Raises RequestError without the extra.
    """
    interrupt = signal.getsignal(signal.SIGINT)
    try:
        import cryptography  # noqa: F401
        import dask_jobqueue  # noqa: F401
        import distributed  # noqa: F401
    except ImportError as error:
        raise RequestError(
            f"{error.name} is not installed; `pip install 's2rtui[tools,cluster]'` installs it"
        ) from error
    finally:
        if interrupt is not None and threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, interrupt)
