"""Standard streams that were closed by who started the command."""

from __future__ import annotations

import os
import sys


def fill_closed() -> None:
    """Put the null device in place of a closed standard input or error.

    A file that is opened later would otherwise take its number, and what is said there.
    """
    if sys.stdin is None:
        _take(0)
        sys.stdin = open(os.devnull, encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        _take(2)
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115


def _take(number: int) -> None:
    try:
        os.fstat(number)
    except OSError:
        null = os.open(os.devnull, os.O_RDWR)
        if null != number:
            os.dup2(null, number)
            os.close(null)
