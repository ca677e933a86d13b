"""Refusals: errors of one line, from a function or from the command `s2r`."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

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
