"""Run one command of `s2r` in a SLURM job, and show what it prints here.

The job script is that of a worker, with the command in the place of the worker's. The job writes
its output into two files, which are read until it ends.
"""

from __future__ import annotations

import argparse
import codecs
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from s2rstore.errors import RequestError
from s2rtools.precompute.executors.slurm_settings import SlurmSettings, read_settings, with_worker

EXIT_CODES = frozenset({0, 1, 2, 3, 70, 130})
"""With which `s2r` ends; another exit status comes from the shell of the job."""

_POLL_SECONDS, _LONGEST_POLL_SECONDS = 0.5, 10.0
_CALL_SECONDS = 60.0
_WAITS = frozenset({"PENDING", "CONFIGURING", "REQUEUED", "RESIZING", "SUSPENDED", "STOPPED"})
_RUNS = frozenset({"RUNNING", "COMPLETING", "STAGE_OUT", "SIGNALING"})
_FIELD = re.compile(r"(?:^|\s)(JobState|Reason|ExitCode|NodeList)=(\S*)")
_READ_BYTES = 1 << 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument_group("execution").add_argument
    add(
        "--cluster",
        metavar="FILE",
        help="run the command as a SLURM job that the TOML file FILE describes, and show its "
        "output here (see the guide)",
    )
    add(
        "--show-job-script",
        action="store_true",
        help="print the script of the job that --cluster FILE submits, and run nothing",
    )


def is_requested(options: argparse.Namespace) -> bool:
    """Whether a command shall run as a job. Raises RequestError for options without a file."""
    if options.cluster == "":
        raise RequestError("--cluster: names nothing; give a value, or leave the option out")
    if options.show_job_script and not options.cluster:
        raise RequestError("--show-job-script: needs --cluster FILE")
    return options.cluster is not None


class SlurmJob:
    """The job of a command, as its options describe it."""

    def __init__(self, options: argparse.Namespace) -> None:
        from s2rtools.precompute.executors.clusters import local_workers, require_extra

        if local_workers(options.cluster) is not None:
            raise RequestError(
                f"--cluster {options.cluster}: is for `s2r precompute`; here name a TOML file with "
                "a table [slurm]"
            )
        require_extra()
        self._settings = read_settings(Path(options.cluster))
        self._options = options

    def store_folder(self, store: Path) -> str:
        """The folder of a store on the nodes."""
        return self._settings.store or str(store.resolve())

    def run(self, words: Sequence[str], seconds: float = 0.0, option: str = "") -> int:
        """Run `s2r` with the arguments `words` in the job; its exit code.

        Raises RequestError where `option`, which says that it takes so many `seconds`, exceeds the
        wall time.
        """
        settings, name = self._settings, f"s2r-{words[0]}"
        if seconds >= settings.seconds():
            raise RequestError(
                f"{option}: takes at least the walltime {settings.walltime} of {settings.file}; "
                "shorten it, or raise the walltime"
            )
        if self._options.show_job_script:
            print(command_script(settings, name, words), end="")
            return 0
        return run_command(settings, name, words, _report_line)


def _report_line(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


@dataclass(frozen=True, slots=True)
class JobFacts:
    """A job as `scontrol` shows it: state, reason for waiting, nodes, exit status and signal."""

    state: str
    reason: str
    nodes: str
    exit_status: int
    signal: int

    @classmethod
    def read(cls, text: str) -> JobFacts:
        """The facts in what `scontrol show job --oneliner` prints."""
        fields = dict(_FIELD.findall(text))
        status, _, signal = fields.get("ExitCode", "0:0").partition(":")
        return cls(
            fields.get("JobState", ""), fields.get("Reason", ""), fields.get("NodeList", ""),
            int(status or 0), int(signal or 0),
        )  # fmt: skip

    @property
    def has_ended(self) -> bool:
        return self.state not in _WAITS | _RUNS


def command_script(settings: SlurmSettings, name: str, words: Sequence[str]) -> str:
    """The script of a job with some name that runs `s2r` with the arguments `words`."""
    from s2rtools.precompute.executors.slurm_jobs import job_class

    program = f"{shlex.quote(settings.python)} -P -m s2rtui"
    command = f"export OMP_NUM_THREADS={settings.cores}\n{program} {shlex.join(words)}"
    options = settings.job_options() | {"job_name": name}
    printed = str(job_class(settings)("tls://SCHEDULER:PORT", name=name, **options).job_script())
    return with_worker(printed, command)


def run_command(
    settings: SlurmSettings,
    name: str,
    words: Sequence[str],
    report_line: Callable[[str], None],
    streams: tuple[TextIO, TextIO] | None = None,
) -> int:
    """Run `s2r` with the arguments `words` in a job, and return its exit code.

    What the job prints is written to `streams`, by default the standard streams. When this process
    is interrupted, the job is cancelled. Raises RequestError where `sbatch` accepts no job, where
    SLURM or the shell ends it, and where SLURM cannot be asked for it, which leaves the job alone.
    """
    folder = Path(settings.log_folder or ".").expanduser().resolve()
    script = command_script(settings, name, words)
    job = _submit(settings, script, folder / name)
    logs = tuple(folder / f"{name}-{job}.{end}" for end in ("out", "err"))
    report_line(f"job {job} submitted; its output goes to {logs[0]} and {logs[1].name}")
    try:
        facts = _follow(settings, job, logs, streams or (sys.stdout, sys.stderr), report_line)
    except KeyboardInterrupt:
        with suppress(OSError, subprocess.SubprocessError):
            _call("scancel", job)
        raise
    if facts.state == "COMPLETED":
        return 0
    where = f"{settings.file}: job {job}"
    if facts.state != "FAILED" or facts.signal:
        raise RequestError(f"{where} was ended ({facts.state}, {facts.reason}); see {logs[1]}")
    if facts.exit_status not in EXIT_CODES:
        raise RequestError(f"{where}: its script failed with {facts.exit_status}; see {logs[1]}")
    return facts.exit_status


def _submit(settings: SlurmSettings, script: str, stem: Path) -> str:
    """Submit a job that writes to `stem`-NUMBER.out and .err; its number."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    command = (
        "sbatch", "--parsable", "--open-mode=append", f"--output={stem}-%j.out",
        f"--error={stem}-%j.err",
    )  # fmt: skip
    try:
        answer = _call(*command, standard_input=script)
    except (OSError, subprocess.SubprocessError) as error:
        raise RequestError(f"{settings.file}: no job could be submitted ({error})") from error
    if answer.returncode:
        reason = "; ".join(answer.stderr.split("\n")).strip("; ") or f"status {answer.returncode}"
        raise RequestError(f"{settings.file}: no job could be submitted ({reason})")
    return answer.stdout.strip().partition(";")[0]


def _follow(
    settings: SlurmSettings,
    job: str,
    logs: Sequence[Path],
    streams: Sequence[TextIO],
    report_line: Callable[[str], None],
) -> JobFacts:
    """Copy the output of a job until it ends; its last facts."""
    copies = [_LogCopy(log, stream) for log, stream in zip(logs, streams, strict=True)]
    told, pause = "", _POLL_SECONDS
    while True:
        facts = _facts(settings, job)
        for copy in copies:
            copy.copy_new()
        if facts.has_ended:
            return facts
        if facts.state in _WAITS:
            line = f"job {job} waits" + ("" if facts.reason == "None" else f" ({facts.reason})")
        else:
            line = f"job {job} runs on {facts.nodes}"
        if line != told:
            report_line(line)
            told, pause = line, _POLL_SECONDS
        time.sleep(pause)
        pause = min(1.5 * pause, _LONGEST_POLL_SECONDS)


def _facts(settings: SlurmSettings, job: str) -> JobFacts:
    """Ask SLURM for a job; a controller that does not answer is asked again for a minute."""
    deadline = time.monotonic() + _CALL_SECONDS
    while True:
        try:
            answer = _call("scontrol", "show", "job", "--oneliner", job)
            if answer.returncode == 0:
                return JobFacts.read(answer.stdout)
            reason = answer.stderr.strip().partition("\n")[0]
        except subprocess.TimeoutExpired:
            reason = "no answer"
        if time.monotonic() > deadline or "Invalid job id" in reason:
            raise RequestError(
                f"{settings.file}: SLURM does not show job {job} ({reason}); if it runs, it goes "
                "on, and its output is in the files named above"
            )
        time.sleep(1.0)


def _call(*command: str, standard_input: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, input=standard_input, capture_output=True, text=True, errors="replace",
        timeout=_CALL_SECONDS, check=False,
    )  # fmt: skip


class _LogCopy:
    """Copies what is appended to a file; it is opened each time, so that NFS asks its server.

    What cannot be read at one time is copied the next time.
    """

    def __init__(self, path: Path, stream: TextIO) -> None:
        self._path, self._stream, self._offset = path, stream, 0
        self._decoder = codecs.getincrementaldecoder("utf-8")("replace")

    def copy_new(self) -> None:
        with suppress(OSError), self._path.open("rb") as file:
            file.seek(self._offset)
            while block := file.read(_READ_BYTES):
                self._offset += len(block)
                self._stream.write(self._decoder.decode(block))
            self._stream.flush()
