"""ctrl+c: what a command says then, and an end of those that do not hear it."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable
from functools import wraps
from typing import Any

CODE = 130
PATIENCE = 1.0
"""Seconds until a command that only reads is ended: a query may be in the middle of native code."""

_READING = frozenset({"doctor", "query", "runs", "show", "sql"})
"""Commands that lose nothing when they are cut short."""
_GOES_ON = {
    "precompute": "finished work units are kept, and the same command goes on from there",
    "train": "what was trained is kept, and the same command goes on from there",
    "demo": "finished stages are kept, and the same command goes on from there",
    "ingest": "no store was made",
}
_received = threading.Event()


def watch(command: str | None) -> None:
    """Note every SIGINT, also while native code keeps the interpreter from handling it.

    For the main thread of a process that is one command.
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
        if command in _READING:
            time.sleep(PATIENCE)
            tell(command)
            os._exit(CODE)


def tell(command: str | None) -> None:
    """One line: what an interrupted command has left. Silences what libraries leave undone."""
    warnings.simplefilter("ignore")
    rest = _GOES_ON.get(command or "")
    print(f"s2r: interrupted; {rest}" if rest else "s2r: interrupted", file=sys.stderr, flush=True)


def interruptible(options: argparse.Namespace) -> Any:
    """Execute a command. Raises KeyboardInterrupt for whatever a library makes of SIGINT."""
    try:
        return options.execute(options)
    except Exception as error:
        if _received.is_set():
            raise KeyboardInterrupt from error
        raise


def ended_quietly(main: Callable[..., int]) -> Callable[..., int]:
    """`main` with one line for a ctrl+c before its command has begun, or while it ends."""

    @wraps(main)
    def quiet(*arguments: Any) -> int:
        try:
            return main(*arguments)
        except KeyboardInterrupt:
            tell(None)
            return CODE

    return quiet
