"""Entry point of `s2r`: prepare the standard streams, parse the arguments, execute one command.

Each command is a module of `cli.commands` or of a package of `s2rtools`.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import sys
from collections.abc import Iterator, Sequence

from s2rstore import plugins
from s2rstore.security import working_folder
from s2rstore.security.printable_text import printable, printable_stream
from s2rtui.cli import interrupts
from s2rtui.cli.command_parser import COMMANDS, build_parser
from s2rtui.cli.error_messages import describe

_EVERYWHERE = ("--debug", "--no-plugins")
"""Options that every command takes, at any place."""
_TORCH_ENVIRONMENT = {"OMP_WAIT_POLICY": "PASSIVE", "GOMP_SPINCOUNT": "0"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    `argv` defaults to the arguments of the process, which then also watches for SIGINT and does
    not wait for background threads when it ends.

    Exit codes: 0 success, 1 negative result, 2 wrong request, 3 inconclusive, 70 internal error,
    130 interrupted.
    """
    try:
        return _main(argv)
    except KeyboardInterrupt:
        interrupts.report_interrupt(None)
        return interrupts.EXIT_CODE


def _main(argv: Sequence[str] | None) -> int:
    for name, value in _TORCH_ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    working_folder.distrust()
    arguments = _with_default_command(list(sys.argv[1:] if argv is None else argv))
    if not (_prepare_streams() and _are_utf8(arguments)):
        return 2
    if "--no-plugins" in arguments:
        os.environ[plugins.DISABLED] = "1"  # also for processes that the command starts
    command = next((word for word in arguments if word in COMMANDS), None)
    if argv is None:
        interrupts.watch_sigint(command)
    with _escaped_streams():
        code = _parse_and_execute(arguments, command)
    background = sys.modules.get("s2rtui.jobs.background_thread")
    if argv is not None or background is None:
        return code
    return int(background.end_process(code))


def _parse_and_execute(arguments: list[str], command: str | None) -> int:
    parser = build_parser([command] if command else [])
    options = parser.parse_args([word for word in arguments if word not in _EVERYWHERE])
    if not hasattr(options, "execute"):
        parser.print_help()
        return 2
    options.debug = "--debug" in arguments
    try:
        return execute_command(options)
    finally:
        for line in plugins.left_out():
            print(printable(f"s2r: plug-in left out: {line}"), file=sys.stderr)


def execute_command(options: argparse.Namespace) -> int:
    """Execute a parsed command and return its exit code; print a message for its exception."""
    try:
        code = int(interrupts.execute_interruptibly(options) or 0)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        interrupts.report_interrupt(options.command)
        return interrupts.EXIT_CODE
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if options.debug:
            raise
        message, code = describe(error)
        print(f"s2r: {message}", file=sys.stderr)
        return code


def _with_default_command(arguments: list[str]) -> list[str]:
    """Insert `tui` where the first word is a path or URL: `s2r S.s2r` means `s2r tui S.s2r`."""
    first = next((word for word in arguments if not word.startswith("-")), None)
    if first is None or first in COMMANDS:
        return arguments
    is_path = first.rstrip("/").endswith(".s2r") or "://" in first or os.path.exists(first)
    return ["tui", *arguments] if is_path else arguments


def _prepare_streams() -> bool:
    """Replace a closed standard input or error by the null device.

    Otherwise the next file that is opened would get its descriptor. Returns False, after a message,
    where standard output is closed.
    """
    if sys.stdin is None:
        _reserve_descriptor(0)
        sys.stdin = open(os.devnull, encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        _reserve_descriptor(2)
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stdout is None:
        print("s2r: the standard output is closed", file=sys.stderr)
        return False
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    return True


def _reserve_descriptor(number: int) -> None:
    """Open the null device as file descriptor `number` unless that is open."""
    try:
        os.fstat(number)
    except OSError:
        null = os.open(os.devnull, os.O_RDWR)
        if null != number:
            os.dup2(null, number)
            os.close(null)


def _are_utf8(arguments: list[str]) -> bool:
    """Return whether all arguments can be encoded; print a message for the first that cannot."""
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError:
            print(f"s2r: argument {argument!a} is not UTF-8", file=sys.stderr)
            return False
    return True


@contextlib.contextmanager
def _escaped_streams() -> Iterator[None]:
    """Escape control characters on standard error, and on standard output if it is a terminal.

    A pipe receives names unchanged.
    """
    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.redirect_stderr(printable_stream(sys.stderr)))
        if sys.stdout.isatty():
            stack.enter_context(contextlib.redirect_stdout(printable_stream(sys.stdout)))
        yield
