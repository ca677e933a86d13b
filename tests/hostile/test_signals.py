"""Closed streams, interrupts and SIGTERM: prompt end, one line and the correct exit code."""

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pytest

from bench.support.processes import processor_seconds, program_environment, wait_until
from s2rtui.cli import main

_LONG_QUERY = "SELECT count(*) FROM range(100000000000)"
# One chunk of rows takes seconds, and DuckDB checks for signals between chunks.
_LONG_CHUNK_QUERY = (
    "SELECT sum(list_sum(list_transform(range(20000000), lambda x: x % 7))) FROM range(400)"
)
_LONG_UNITS_SCRIPT = """
import sys, time
from collections.abc import Callable
from typing import NamedTuple
from s2rtools.precompute.executors.executor import Task
from s2rtools.precompute.executors.local_executors import ProcessExecutor, WorkerPool

class LongComputation(NamedTuple):
    def open(self, threads: int) -> Callable[[object], object]:
        return wait

def wait(unit: object) -> None:
    print("computing", flush=True)
    time.sleep(600)

if __name__ == "__main__":
    tasks = [Task(LongComputation(), 1)]
    try:
        with WorkerPool(lambda line: print(line, flush=True)) as pool:
            list(ProcessExecutor(1, 1, pool).run(tasks))
    except KeyboardInterrupt:
        sys.exit(130)
"""


def _command(*arguments: str) -> list[str]:
    return [sys.executable, "-P", "-m", "s2rtui", *arguments]


_ENVIRONMENT = program_environment(TERM="xterm-256color")


def _run_redirected(arguments: Sequence[str], streams: str) -> subprocess.CompletedProcess[str]:
    script = f'"$@" {streams}'
    return subprocess.run(
        ["sh", "-c", script, "sh", *_command(*arguments)], env=_ENVIRONMENT, text=True,
        capture_output=True, timeout=300,
    )  # fmt: skip


@pytest.mark.parametrize("piped", [(True, False, False), (False, True, False), (True, True, True)])
def test_the_application_requires_a_terminal(tiny_store, piped):
    """Standard input, output or all streams are pipes."""
    primary, secondary = os.openpty()
    streams = [subprocess.PIPE if pipe else secondary for pipe in piped]
    process = subprocess.Popen(
        _command("tui", str(tiny_store)), env=_ENVIRONMENT,
        stdin=streams[0], stdout=streams[1], stderr=streams[2],
    )  # fmt: skip
    try:
        _, error = process.communicate(timeout=300)
        error = error if piped[2] else os.read(primary, 4096)
    finally:
        process.kill()
        process.wait()
        os.close(primary)
        os.close(secondary)
    assert process.returncode == 2
    assert error.count(b"\n") == 1
    assert b"no terminal" in error


@pytest.mark.parametrize(
    ("streams", "result"),
    [("<&- 2>&-", (0, "6\n", "")), (">&-", (2, "", "s2r: the standard output is closed\n"))],
)
def test_a_closed_output_stream_alone_is_an_error(tiny_store, streams, result):
    process = _run_redirected(("query", str(tiny_store), "worst15", "--count"), streams)
    assert (process.returncode, process.stdout, process.stderr) == result


@pytest.mark.parametrize("streams", ["<&-", "<&- >&- 2>&-"])
def test_the_application_rejects_closed_streams(tiny_store, streams):
    process = _run_redirected(("tui", str(tiny_store)), streams)
    assert process.returncode == 2
    assert process.stderr.count("\n") <= 1
    assert "fault" not in process.stderr


def _start(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        _command(*arguments), env=_ENVIRONMENT, text=True, start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_ctrl_c_ends_a_query(tiny_store):
    process = _start("sql", str(tiny_store), "--memory", "4GB", _LONG_CHUNK_QUERY)
    assert wait_until(lambda: processor_seconds(process.pid) > 2, 60)
    os.killpg(process.pid, signal.SIGINT)
    out, error = process.communicate(timeout=300)
    assert (process.returncode, out, error) == (130, "", "s2r: interrupted\n")


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_sigterm_ends_a_query(tiny_store):
    process = _start("sql", str(tiny_store), _LONG_QUERY)
    assert wait_until(lambda: processor_seconds(process.pid) > 2, 60)
    process.terminate()
    out, error = process.communicate(timeout=300)
    assert (process.returncode, out, error) == (-signal.SIGTERM, "", "")


@pytest.mark.parametrize(
    ("command", "expected"),
    [
        ("ingest", "no store was created"),
        ("precompute", "finished work units are kept"),
        ("train", "the training state is kept"),
        ("verify", ""),
    ],
)
def test_an_interrupted_command_reports_what_is_retained(
    tmp_path, capsys, monkeypatch, command, expected
):
    from s2rtui.cli import command_parser

    def interrupted(options: object) -> int:
        raise KeyboardInterrupt

    loaded = command_parser.load_command(command)._replace(execute=interrupted)
    monkeypatch.setattr(command_parser, "load_command", lambda name: loaded)
    command_lines = {
        "ingest": ["ingest", "world", "--store", "s.s2r"],
        "precompute": ["precompute", "s.s2r"],
        "train": ["train", "--recipe", "vanilla", "--minutes", "1", "--store", "s.s2r"],
        "verify": ["verify", "s.s2r"],
    }
    assert main(command_lines[command]) == 130
    error = capsys.readouterr().err
    assert error.startswith("s2r: interrupted")
    assert error.count("\n") == 1
    assert expected in error
    assert ("kept" in error) == ("kept" in expected)


def _started(folder: Path, content: str) -> subprocess.Popen[str]:
    script = folder / "units.py"
    script.write_text(content)
    return subprocess.Popen(
        [sys.executable, str(script)], env=_ENVIRONMENT, text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


def test_ctrl_c_waits_for_units_in_progress_and_again_drops_them(tmp_path):
    process = _started(tmp_path, _LONG_UNITS_SCRIPT)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "computing\n"
        process.send_signal(signal.SIGINT)
        assert "press ctrl+c again to drop them" in process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=300)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode == 130
    assert "Traceback" not in error
