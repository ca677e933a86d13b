"""Exceptions of a command as one printable line with an exit code."""

from __future__ import annotations

import os
import sys

from s2rstore.errors import S2RError
from s2rstore.security.printable_text import printable

INTERNAL_ERROR = 70


def describe(error: Exception) -> tuple[str, int]:
    """Return the message for an exception and the exit code of the process."""
    code = INTERNAL_ERROR
    if isinstance(error, S2RError):
        message, code = str(error), error.exit_code
    elif isinstance(error, ModuleNotFoundError) and not (error.name or "").startswith("s2r"):
        message = (
            f"the Python package {error.name} is missing; "
            "install it with `pip install 's2rtui[tools]'`"
        )
        code = 2
    elif isinstance(error, MemoryError):
        message, code = "out of memory; select less data, or free memory", 2
    elif isinstance(error, OSError):
        source = error.filename if error.filename is not None else _failed_output(error)
        reason = str(error.strerror or error)
        return printable(f"{source}: {reason}" if source else reason), 2
    else:
        message = f"{type(error).__name__}: {error}"
    if code == INTERNAL_ERROR:
        message = f"internal error: {message} (--debug shows the traceback)"
    return printable(" ".join(message.split())), code


def _failed_output(error: OSError) -> str:
    """Return "standard output" for an error without a file name that a command's output raised.

    Output that could not be written is discarded, so that the end of the process does not fail on
    it again.
    """
    innermost = error.__traceback__
    while innermost is not None and innermost.tb_next is not None:
        innermost = innermost.tb_next
    module = "" if innermost is None else str(innermost.tb_frame.f_globals.get("__name__"))
    prints = module.startswith(("s2rtui.cli", "s2rtools.common.command_line"))
    if not (prints or module.endswith(".command")):
        return ""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return "standard output"
