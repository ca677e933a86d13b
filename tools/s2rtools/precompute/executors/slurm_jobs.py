"""Jobs of SLURM that each run a worker, and what `sbatch` answered to their submission."""

from __future__ import annotations

from queue import SimpleQueue
from typing import Any

from dask_jobqueue.slurm import SLURMCluster, SLURMJob
from distributed import Status

from s2rstore.errors import RequestError
from s2rtools.precompute.executors.executor import RequestedWorkers
from s2rtools.precompute.executors.slurm_settings import SlurmSettings, with_worker


def job_class(settings: SlurmSettings) -> type[SLURMJob]:
    """The class of jobs of some settings: with the user's script, if there is one."""
    script = settings.own_script()
    if script is None:
        return SLURMJob
    own: str = script

    class ScriptedJob(SLURMJob):
        """A job with the user's script."""

        def job_script(self) -> str:
            return with_worker(own, self._command_template)

    return ScriptedJob


class Submissions:
    """The submissions of one cluster's jobs; `workers` are those that the jobs start."""

    def __init__(self, settings: SlurmSettings) -> None:
        self._settings = settings
        self.workers = RequestedWorkers(settings.jobs)
        self._answers: SimpleQueue[str] = SimpleQueue()

    def job_class(self) -> type[SLURMJob]:
        """The class of jobs whose submission is recorded here."""
        workers, answers = self.workers, self._answers

        class RecordedJob(job_class(self._settings)):  # type: ignore[misc]
            """A job that records whether it was accepted."""

            async def start(self) -> None:
                name, refusal = str(self.name), "cancelled"
                try:
                    await super().start()
                    refusal = ""
                except (OSError, RuntimeError, ValueError) as error:
                    refusal = _words(error)
                    raise
                finally:
                    if refusal:
                        workers.refused[name] = refusal
                        self.status = Status.failed
                    else:
                        workers.refused.pop(name, None)
                    answers.put(refusal)

            async def close(self) -> None:
                await super().close()
                self.status = Status.closed

        return RecordedJob

    def submit(self, cluster: SLURMCluster) -> int:
        """Submit all jobs, and keep their number from now on; how many were accepted.

        Raises RequestError with the words of `sbatch` where none was.
        """
        jobs = self._settings.jobs
        cluster.scale(jobs=jobs)
        refusals = [answer for answer in (self._answers.get() for _ in range(jobs)) if answer]
        if len(refusals) == jobs:
            raise RequestError(f"{self._settings.file}: no job could be submitted ({refusals[-1]})")
        cluster.adapt(minimum_jobs=jobs, maximum_jobs=jobs)
        return jobs - len(refusals)


def _words(error: Any) -> str:
    """What `sbatch` said, in one line; dask_jobqueue puts it below `stderr:`."""
    text = str(error).rpartition("stderr:\n")[2].strip() or str(error)
    return "; ".join(line.strip() for line in text.splitlines() if line.strip())
