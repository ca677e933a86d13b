"""Results of the command `s2r`, and refusals: errors of one line."""

import csv
import io
import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from s2rstore.errors import RequestError
from s2rtui.cli import main


@contextmanager
def refused(*texts: str, match: str | None = None) -> Iterator[None]:
    """Expect a RequestError of one line that contains the texts and matches an expression."""
    with pytest.raises(RequestError, match=match) as caught:
        yield
    message = str(caught.value)
    assert "\n" not in message
    for text in texts:
        assert text in message


@dataclass(frozen=True, slots=True)
class CommandResult:
    """Exit code and outputs of `s2r`."""

    code: int
    out: str
    err: str

    def checked(self, code: int = 0) -> "CommandResult":
        """Check the exit code."""
        assert self.code == code, self
        return self

    @property
    def printed(self) -> str:
        """The standard output of a successful command."""
        return self.checked().out

    @property
    def lines(self) -> list[str]:
        """The lines that a successful command printed."""
        return self.printed.splitlines()

    @property
    def rows(self) -> list[dict[str, str]]:
        """The rows that a successful command printed as CSV."""
        return list(csv.DictReader(io.StringIO(self.printed, newline="")))

    @property
    def json(self) -> Any:
        """The object that a successful command printed as JSON."""
        return json.loads(self.printed)

    def assert_refused(self, *texts: str) -> None:
        """Check for exit code 2 and one line of error beside progress, which contains the texts."""
        assert (self.code, self.out) == (2, ""), self
        (line,) = re.sub(r"(?m)^\w+: \d+/\d+, .*\n", "", self.err).splitlines()
        for text in ("s2r: ", *texts):
            assert text in line


def run_command(capsys: pytest.CaptureFixture[str], *words: object) -> CommandResult:
    """Run `s2r` in this process."""
    capsys.readouterr()
    code = main(list(map(str, words)))
    return CommandResult(code, *capsys.readouterr())


RunCommand = Callable[..., CommandResult]
