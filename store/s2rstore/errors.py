"""Errors that a user can act on; each carries the exit code of the command line."""

from __future__ import annotations


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


class StoreBusyError(RequestError):
    """Another process holds the lock that this one needs."""
