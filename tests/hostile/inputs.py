"""Run `s2r` on hostile inputs in a subprocess and check how it ended."""

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

MAX_MEGABYTES = 600


@dataclass(frozen=True)
class ProcessResult:
    """Exit code, outputs and peak memory of a process."""

    code: int
    out: str
    err: str
    megabytes: float

    def assert_rejected(self, *words: str) -> None:
        """Check for exit code 2, a last line that contains all `words`, and low memory use."""
        assert self.code == 2, (self.code, self.err)
        last = self.err.strip().splitlines()[-1]
        assert last.startswith("s2r: "), self.err
        assert "Traceback" not in self.err
        for expected in words:
            assert expected in last, self.err
        assert self.megabytes < MAX_MEGABYTES


def s2r(folder: Path, *arguments: str | Path, seconds: float = 300) -> ProcessResult:
    """Run the command in a subprocess; a process that hangs is killed and fails the test."""
    out, err = folder / "stdout.txt", folder / "stderr.txt"
    command = [sys.executable, "-m", "s2rtui", *map(str, arguments)]
    with out.open("wb") as stdout, err.open("wb") as stderr:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=stdout, stderr=stderr)
        deadline_time, peak = time.monotonic() + seconds, 0.0
        while process.poll() is None:
            peak = max(peak, _peak(process.pid))
            if time.monotonic() > deadline_time:
                process.kill()
                process.wait()
                raise AssertionError(f"hangs: {' '.join(command)}")
            time.sleep(0.005)
    texts = (file.read_text(errors="replace") for file in (out, err))
    return ProcessResult(process.returncode, *texts, peak)


def _peak(process: int) -> float:
    """Peak memory in MB; `wait4` would include the memory of this process before the exec."""
    try:
        status = Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0.0
    values = [line.split()[1] for line in status.splitlines() if line.startswith("VmHWM:")]
    return int(values[0]) / 1024 if values else 0.0


@contextmanager
def deadline(seconds: int = 120) -> Iterator[None]:
    """Fail if the block takes longer than `seconds`."""

    def on_alarm(*_: object) -> None:
        raise AssertionError(f"hangs for {seconds} s")

    previous = signal.signal(signal.SIGALRM, on_alarm)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, previous)


def limits() -> tuple[int, int]:
    """The soft limits of this process on data and file size."""
    kinds = (resource.RLIMIT_DATA, resource.RLIMIT_FSIZE)
    data, file = (resource.getrlimit(kind)[0] for kind in kinds)
    return data, file


def png(array: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", array)[1])


def jpeg(array: np.ndarray, *options: int) -> bytes:
    return bytes(cv2.imencode(".jpg", array, [cv2.IMWRITE_JPEG_QUALITY, 95, *options])[1])
