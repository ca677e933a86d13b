"""Options of commands that may run as one SLURM job."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from s2rstore.errors import RequestError


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
        from s2rtools.precompute.executors.slurm_settings import read_settings

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
        from s2rtools.precompute.executors.slurm_command import command_script, run_command

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
