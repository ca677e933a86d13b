"""A reporter that keeps to itself."""

from __future__ import annotations


class SilentReporter:
    """Counts steps and keeps lines."""

    def __init__(self) -> None:
        self.steps = 0
        self.lines: list[str] = []

    def begin(self, what: str, total: int) -> None: ...

    def advance(self, steps: int) -> None:
        self.steps += steps

    def say(self, line: str) -> None:
        self.lines.append(line)
