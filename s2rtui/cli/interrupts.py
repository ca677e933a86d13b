"""Handling of ctrl+c: the message that a command prints, and the end of commands that block."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
import time
import warnings
from typing import Any

EXIT_CODE = 130
GRACE_SECONDS = 1.0
"""Time until a read-only command is ended: a query may be inside native code."""

_READ_ONLY = frozenset({"doctor", "query", "runs", "show", "sql"})
"""Commands that lose nothing when they are ended at once."""
_RESUME_HINTS = {
    "precompute": "finished work units are kept; run the same command to continue",
    "train": "the training state is kept; run the same command to continue",
    "demo": "finished stages are kept; run the same command to continue",
    "ingest": "no store was created",
}
_received = threading.Event()


def watch_sigint(command: str | None) -> None:
    """Note every SIGINT, even while native code keeps the interpreter from handling it.

    Call it in the main thread of a process that executes one command.
    """
    source, sink = os.pipe()
    os.set_blocking(sink, False)
    signal.set_wakeup_fd(sink, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(source, command), name="interrupts", daemon=True).start()


def _watch(source: int, command: str | None) -> None:
    while numbers := os.read(source, 64):
        if signal.SIGINT not in numbers:
            continue
        _received.set()
        if command in _READ_ONLY:
            time.sleep(GRACE_SECONDS)
            report_interrupt(command)
            os._exit(EXIT_CODE)


def report_interrupt(command: str | None) -> None:
    """Print one line about an interrupted command, and silence later warnings."""
    warnings.simplefilter("ignore")
    hint = _RESUME_HINTS.get(command or "")
    print(f"s2r: interrupted; {hint}" if hint else "s2r: interrupted", file=sys.stderr, flush=True)


def execute_interruptibly(options: argparse.Namespace) -> Any:
    """Execute a command; raise KeyboardInterrupt for any exception that follows a SIGINT."""
    try:
        return options.execute(options)
    except Exception as error:
        if _received.is_set():
            raise KeyboardInterrupt from error
        raise
