"""Commands without their streams, interrupted or told to end: one line, the right code, at once."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from bench.support.processes import processor_seconds, wait_until
from s2rtui.cli import main

_LONG = "SELECT count(*) FROM range(100000000000)"
# One chunk of rows takes seconds, and the library looks for signals between chunks.
_LONG_CHUNK = (
    "SELECT sum(list_sum(list_transform(range(20000000), lambda x: x % 7))) FROM range(400)"
)
_WORKERS = """
import os, signal, sys, threading
from pathlib import Path
from s2rtools.precompute import executors
from tests.hostile.interrupted_units import opener

if __name__ == "__main__":
    try:
        list(executors.run_units(Path("."), [1, 2], opener, 2))
    except KeyboardInterrupt:
        sys.exit(130)
"""


def _command(*words: str) -> list[str]:
    return [sys.executable, "-P", "-m", "s2rtui", *words]


def _environment() -> dict[str, str]:
    path = os.pathsep.join(part for part in sys.path if part)
    return {**os.environ, "PYTHONPATH": path, "TERM": "xterm-256color"}


def _redirected(words: Sequence[str], streams: str) -> subprocess.CompletedProcess[str]:
    script = f'"$@" {streams}'
    return subprocess.run(
        ["sh", "-c", script, "sh", *_command(*words)], env=_environment(), text=True,
        capture_output=True, timeout=60,
    )  # fmt: skip


@pytest.mark.parametrize("piped", [p for p in itertools.product([False, True], repeat=3) if any(p)])
def test_the_application_without_a_terminal(tiny_store: Path, piped: tuple[bool, ...]) -> None:
    """Standard input, output and error are a terminal or a pipe."""
    primary, secondary = os.openpty()
    streams = [subprocess.PIPE if pipe else secondary for pipe in piped]
    process = subprocess.Popen(
        _command("tui", str(tiny_store)), env=_environment(),
        stdin=streams[0], stdout=streams[1], stderr=streams[2],
    )  # fmt: skip
    try:
        _, told = process.communicate(timeout=60)
        told = told if piped[2] else os.read(primary, 4096)
    finally:
        process.kill()
        process.wait()
        os.close(primary)
        os.close(secondary)
    assert process.returncode == 2
    assert told.count(b"\n") == 1
    assert b"no terminal" in told


@pytest.mark.parametrize("streams", ["<&-", "2>&-", "<&- 2>&-"])
def test_a_closed_input_or_error_stream_harms_nothing(tiny_store: Path, streams: str) -> None:
    done = _redirected(("query", str(tiny_store), "worst15", "--count"), streams)
    assert (done.returncode, done.stdout, done.stderr) == (0, "6\n", "")


@pytest.mark.parametrize("streams", [">&-", "<&- >&-"])
def test_a_closed_output_stream_is_one_line(tiny_store: Path, streams: str) -> None:
    done = _redirected(("query", str(tiny_store), "worst15"), streams)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == "s2r: the standard output is closed\n"


@pytest.mark.parametrize("streams", ["<&-", "2>&-", ">&-", "<&- >&- 2>&-"])
def test_the_application_with_closed_streams(tiny_store: Path, streams: str) -> None:
    done = _redirected(("tui", str(tiny_store)), streams)
    assert done.returncode == 2
    assert done.stderr.count("\n") <= 1
    assert "fault" not in done.stderr


def _started(*words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        _command(*words), env=_environment(), text=True, start_new_session=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("query", [_LONG, _LONG_CHUNK])
def test_ctrl_c_ends_a_query(tiny_store: Path, query: str) -> None:
    process = _started("sql", str(tiny_store), "--memory", "4GB", query)
    assert wait_until(lambda: processor_seconds(process.pid) > 2, 60)
    os.killpg(process.pid, signal.SIGINT)
    out, told = process.communicate(timeout=20)
    assert (process.returncode, out, told) == (130, "", "s2r: interrupted\n")


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_sigterm_ends_a_query(tiny_store: Path) -> None:
    process = _started("sql", str(tiny_store), _LONG)
    assert wait_until(lambda: processor_seconds(process.pid) > 2, 60)
    process.terminate()
    out, told = process.communicate(timeout=20)
    assert (process.returncode, out, told) == (-signal.SIGTERM, "", "")


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_sigterm_ends_a_snapshot_without_a_file(tiny_store: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.png"
    size = ("--size", "1000x500")
    process = _started("snapshot", str(tiny_store), *size, "--keys", "w,w,w,w", "--out", str(out))
    assert wait_until(lambda: processor_seconds(process.pid) > 1.5, 60)
    process.terminate()
    process.communicate(timeout=20)
    assert process.returncode == -signal.SIGTERM
    assert not out.exists()


@pytest.mark.parametrize(
    ("command", "kept"),
    [
        ("ingest", "no store was created"),
        ("precompute", "finished work units are kept"),
        ("train", "the training state is kept"),
        ("verify", ""),
    ],
)
def test_what_an_interrupt_leaves(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    kept: str,
) -> None:
    import importlib

    def interrupted(options: object) -> int:
        raise KeyboardInterrupt

    module = importlib.import_module(f"s2rtui.cli.commands.{command}")
    monkeypatch.setattr(module, "execute", interrupted)
    words = {
        "ingest": ["ingest", "world", "--store", "s.s2r"],
        "precompute": ["precompute", "s.s2r"],
        "train": ["train", "--recipe", "vanilla", "--minutes", "1", "--store", "s.s2r"],
        "verify": ["verify", "s.s2r"],
    }
    assert main(words[command]) == 130
    told = capsys.readouterr().err
    assert told.startswith("s2r: interrupted")
    assert told.count("\n") == 1
    assert kept in told
    assert ("kept" in told) == ("kept" in kept)


def test_ctrl_c_while_workers_start_is_no_traceback(tmp_path: Path) -> None:
    script = tmp_path / "units.py"
    script.write_text(_WORKERS)
    process = subprocess.Popen(
        [sys.executable, str(script)], env=_environment(), text=True, start_new_session=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    _, told = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "KeyboardInterrupt" not in told


@pytest.mark.parametrize("name", ["brightness", "contrast", "depth_blur", "camera_pitch"])
def test_an_adjustment_without_a_value(
    store_copy: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    words = ["run", "add", "new", "--model", "vanilla", "--adjust", f"real:{name}"]
    assert main([*words, "--store", str(store_copy)]) == 2
    told = capsys.readouterr().err
    assert f"such as {name}=" in told
    assert told.count("\n") == 1
