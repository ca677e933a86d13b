"""Work units during whose start somebody presses ctrl+c: it reaches the whole process group."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable
from pathlib import Path

if multiprocessing.current_process().name == "SpawnProcess-1":
    os.killpg(0, signal.SIGINT)  # this worker is still importing


def opener(root: Path, threads: int) -> Callable[[object], None]:
    """Computes nothing."""
    return _nothing


def _nothing(unit: object) -> None:
    return None
