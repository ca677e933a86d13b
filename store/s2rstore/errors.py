"""Errors that a user can act on, each with its exit code, and parts of messages."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from itertools import islice


class S2RError(Exception):
    """One line that names the file or argument and what to do."""

    exit_code = 70


class RequestError(S2RError):
    """The request is wrong: a missing file, an unknown name, a bad expression."""

    exit_code = 2


class CheckFailedError(S2RError):
    """A check failed: a gate, or the verification of a store."""

    exit_code = 1


class InconclusiveError(S2RError):
    """The evidence does not allow an answer."""

    exit_code = 3


def missing_package(package: str, extra: str = "") -> RequestError:
    """The error where an optional package is not installed; `extra` is that of s2rtui with it."""
    install = f"'s2rtui[{extra}]'" if extra else package
    message = f"the Python package {package} is missing; install it with `pip install {install}`"
    return RequestError(message)


class StoreBusyError(RequestError):
    """Another process holds the lock that this one needs."""


class NotComputedError(RequestError):
    """A result that `s2r precompute` has not computed yet, for the run or for some instances."""


class DamagedStoreError(RequestError):
    """A file of a store is missing, unreadable or not as published; the message names the file."""


class UnreachableStoreError(S2RError):
    """A server does not give a file now: refused, timed out, or the connection was cut.

    That says nothing about the file: it is no damage, and code that reports damage lets it pass.
    """

    exit_code = 2


class ExpressionError(RequestError):
    """A wrong expression; `column` counts from 1, `expected` lists what is valid there."""

    def __init__(self, column: int, problem: str, expected: Iterable[str] = ()) -> None:
        self.column = column
        self.expected = tuple(expected)
        hint = f"; could be {', '.join(self.expected)}" if self.expected else ""
        super().__init__(f"column {column}: {shortened(problem, _MAX_PROBLEM)}{hint}")


_MAX_NAME, _MAX_NAMES = 100, 2000
"""Characters of a name, and number of names, that are compared with an unknown name."""
_MAX_PROBLEM = 400


def unknown(column: int, what: str, name: str, known: Iterable[str]) -> ExpressionError:
    """An unknown name, with the nearest known ones first."""
    names = [shortened(each) for each in islice(known, _MAX_NAMES)]
    near = difflib.get_close_matches(name[:_MAX_NAME], names, n=3, cutoff=0.5) or names[:8]
    problem = f"no {what} {shortened(name)!r}"
    return ExpressionError(column, problem if near else f"{problem}, nor any other", near)


def first_line(error: BaseException) -> str:
    """The first line of an error's message, or else its type."""
    return next(iter(str(error).splitlines()), "") or type(error).__name__


def one_line(error: BaseException) -> str:
    """An error's message with its lines joined."""
    return " ".join(str(error).split())


def shortened(text: str, limit: int = _MAX_NAME) -> str:
    """A text for a message: at most `limit` characters."""
    return text if len(text) <= limit else f"{text[: limit - 3]}..."


def counted(count: int, noun: str) -> str:
    """A number with its noun for a message, such as `1 issue` or `3 issues`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def sentence(text: str) -> str:
    """Return the text with its first letter in upper case and all others unchanged."""
    return text[:1].upper() + text[1:]
