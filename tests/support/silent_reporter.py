"""A progress reporter that prints nothing."""


class SilentReporter:
    """Counts the steps and collects the lines."""

    def __init__(self) -> None:
        self.steps, self.total = 0, 0
        self.lines: list[str] = []

    def begin(self, what: str, total: int) -> None:
        self.total += total

    def advance(self, steps: int) -> None:
        self.steps += steps

    def say(self, line: str) -> None:
        self.lines.append(line)
