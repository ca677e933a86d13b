"""Replay terminal screens from recorded bytes and report what is wrong with them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from bench.support.screen import emulator, feed

STATUS = re.compile(
    r"(?P<chosen>\d+) of (?P<all>\d+) (\(\d+ trained on[^)]*\) )?. .* . "
    r"generation (?P<generation>\d+)"
)
TROUBLE = re.compile(r"Traceback|[A-Z][a-z]+Error\b|damaged|cannot be|no such|run `s2r")


def replay(raw: bytes, ends: Sequence[int], size: tuple[int, int]) -> list[str]:
    """Errors on the screens as they stood after each of `ends` bytes."""
    screen, stream = emulator(size)
    found = []
    begin, rest = 0, b""
    for end in ends:
        rest = feed(stream, rest + raw[begin:end])
        begin = end
        lines = [line.rstrip() for line in screen.display]
        found += faults(lines)
    return found


def faults(lines: Sequence[str]) -> list[str]:
    """What is wrong with a screen of the application: error messages and impossible counts."""
    found = [line.strip() for line in lines if TROUBLE.search(line)]
    status = STATUS.search(lines[0])
    if status is None:
        found.append(f"no status line: {lines[0]!r}")
    elif int(status["chosen"]) > int(status["all"]):
        found.append(f"more are chosen than there are: {lines[0]!r}")
    return found
