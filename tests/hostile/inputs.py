"""Running `s2r` on hostile inputs as a user would, and judging how it ended."""

from __future__ import annotations

import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

MOST_MEGABYTES = 600


@dataclass(frozen=True)
class Ended:
    """Exit code, outputs and peak memory of a process."""

    code: int
    out: str
    err: str
    megabytes: float

    def refused(self, *words: str) -> None:
        """It ended with 2, one last line that says all `words`, and little memory."""
        assert self.code == 2, (self.code, self.err)
        last = self.err.strip().splitlines()[-1]
        assert last.startswith("s2r: "), self.err
        assert "Traceback" not in self.err
        for word in words:
            assert word in last, self.err
        assert self.megabytes < MOST_MEGABYTES


def s2r(folder: Path, *arguments: str | Path, seconds: float = 60) -> Ended:
    """Run the command in a process of its own; it is killed, and fails, where it hangs."""
    out, err = folder / "stdout.txt", folder / "stderr.txt"
    command = [sys.executable, "-m", "s2rtui", *map(str, arguments)]
    with out.open("wb") as stdout, err.open("wb") as stderr:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr)
        until, peak = time.monotonic() + seconds, 0.0
        while process.poll() is None:
            peak = max(peak, _peak(process.pid))
            if time.monotonic() > until:
                process.kill()
                process.wait()
                raise AssertionError(f"hangs: {' '.join(command)}")
            time.sleep(0.005)
    texts = (file.read_text(errors="replace") for file in (out, err))
    return Ended(process.returncode, *texts, peak)


def _peak(process: int) -> float:
    """Peak memory in MB; that of wait4 would begin with this process's own."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    found = [line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:")]
    return int(found[0]) / 1024 if found else 0.0


@contextmanager
def deadline(seconds: int = 20) -> Iterator[None]:
    """Fail where the block hangs."""

    def ring(*_: object) -> None:
        raise AssertionError(f"hangs for {seconds} s")

    before = signal.signal(signal.SIGALRM, ring)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def limits() -> tuple[int, int]:
    """The soft limits of this process on data and file size."""
    kinds = (resource.RLIMIT_DATA, resource.RLIMIT_FSIZE)
    data, file = (resource.getrlimit(kind)[0] for kind in kinds)
    return data, file


def png(array: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", array)[1])


def jpeg(array: np.ndarray, *options: int) -> bytes:
    return bytes(cv2.imencode(".jpg", array, [cv2.IMWRITE_JPEG_QUALITY, 95, *options])[1])
