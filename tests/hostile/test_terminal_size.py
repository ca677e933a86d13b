"""Terminals of any size use bounded memory, and SIGTERM ends the application."""

import fcntl
import os
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from bench.support.processes import peak_bytes, program_environment, wait_until
from bench.support.screen import Screen

MAX_BYTES = 600 << 20
PROMPT_SECONDS = 10.0
OpenScreen = Callable[..., Screen]

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")


@pytest.fixture
def command(tiny_store: Path) -> list[str]:
    return [sys.executable, "-P", "-m", "s2rtui", "tui", "--restricted", str(tiny_store)]


@pytest.fixture
def open_screen(command: list[str], tmp_path: Path) -> Iterator[OpenScreen]:
    """Starts applications on terminals that only count the bytes; no tour is shown."""
    opened: list[Screen] = []
    (tmp_path / "data" / "s2rtui").mkdir(parents=True)
    (tmp_path / "data" / "s2rtui" / "toured").touch()
    path = program_environment()["PYTHONPATH"]
    environment = {"PYTHONPATH": path, "XDG_DATA_HOME": str(tmp_path / "data")}

    def start_screen(columns: int, rows: int) -> Screen:
        opened.append(Screen(command, (80, 24), environment, draws=False))
        opened[-1].resize_terminal(columns, rows)
        return opened[-1]

    yield start_screen
    for screen in opened:
        screen.kill()
        screen.close()


def _ends_promptly(screen: Screen) -> bool:
    start = time.monotonic()
    with suppress(ProcessLookupError):
        os.kill(screen.pid, signal.SIGTERM)
    screen.wait_for_end(30)
    return time.monotonic() - start < 2 * PROMPT_SECONDS


def _draws(screen: Screen, size: int) -> bool:
    return screen.wait_for_bytes(size, 60)


def test_the_largest_size_uses_bounded_memory(open_screen):
    """As the terminal has it, and as it is reported by an escape sequence."""
    screen = open_screen(65_535, 65_535)
    assert _draws(screen, 1 << 18)
    screen.press("\x1b[?2048;2$y")
    screen.press("\x1b[48;50000;50000;9;9t")
    assert _draws(screen, screen.received + (1 << 18))
    assert peak_bytes(screen.pid) < MAX_BYTES
    assert _ends_promptly(screen)


def test_an_endless_paste_uses_bounded_memory(open_screen):
    screen = open_screen(80, 24)
    assert _draws(screen, 4000)
    screen.press("\x1b[200~")
    for _ in range(300):
        screen.press(b"x" * 4000)
    screen.press("\x1b[201~")
    before = screen.received
    screen.press("?")
    assert _draws(screen, before + 1)
    assert peak_bytes(screen.pid) < MAX_BYTES
    assert _ends_promptly(screen)


def test_a_terminal_that_reads_no_output(command, tmp_path):
    """The output buffer is full and blocks the event loop."""
    primary, secondary = os.openpty()
    variables = {"XDG_DATA_HOME": str(tmp_path), "TERM": "xterm-256color"}
    size = {"COLUMNS": "400", "LINES": "200"}
    process = subprocess.Popen(
        command, stdin=secondary, stdout=secondary, stderr=secondary,
        env=program_environment(**variables, **size),
    )  # fmt: skip
    try:
        assert wait_until(lambda: _buffered_bytes(primary) >= 2048, 60)
        start = time.monotonic()
        process.terminate()
        process.wait(30)
        assert time.monotonic() - start < 2 * PROMPT_SECONDS
    finally:
        process.kill()
        process.wait()
        os.close(primary)
        os.close(secondary)


def _buffered_bytes(primary: int) -> int:
    """Bytes in the buffer of a terminal."""
    return int(struct.unpack("i", fcntl.ioctl(primary, termios.FIONREAD, bytes(4)))[0])


def test_image_sizes_are_limited(tiny_store, tmp_path, s2r):
    out = tmp_path / "out.png"
    for size in ("100000x100000", "1001x500", "1000x501", "9x9", "0x0", "٣٠x٣٠"):
        s2r("snapshot", tiny_store, "--size", size, "--out", out).assert_refused("20x5 to 1000x500")
    for size in ("100000x100000", "9x9", "0x0"):
        arguments = ["export", str(tiny_store), "--view", "map", "--size", size, "--out", str(out)]
        s2r(*arguments).assert_refused("8000x8000")
    assert not out.exists()


def test_the_largest_image_uses_bounded_memory(tiny_store, tmp_path):
    arguments = ["snapshot", str(tiny_store), "--size", "1000x500"]
    program = [sys.executable, "-P", "-m", "s2rtui", *arguments]
    out = tmp_path / "out.png"
    # An intermediate process, because the peak size of a child includes that of its parent.
    measuring_script = (
        "import resource, subprocess, sys; code = subprocess.call(sys.argv[1:]);"
        "print(code, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)"
    )
    process = subprocess.run(
        [sys.executable, "-c", measuring_script, *program, "--out", str(out)],
        env=program_environment(), capture_output=True, text=True, check=True,
    )  # fmt: skip
    code, largest = map(int, process.stdout.split()[-2:])
    assert code == 0
    assert largest * 1024 < MAX_BYTES
    assert out.stat().st_size > 10_000
