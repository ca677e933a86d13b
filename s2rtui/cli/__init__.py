"""The `s2r` command: one module per command, imported only when it is asked for."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import sys
from collections.abc import Iterator, Sequence
from typing import NoReturn

from s2rstore.security import working_folder
from s2rtui.cli import interrupts, standard_streams

COMMANDS: dict[str, str] = {
    "demo": "the default world, or your images, from nothing to findings on the screen",
    "ingest": "make a store from paired images, or from the default world",
    "train": "train a model with one of the recipes and register a run of it",
    "model": "register a trained model, or those that come with the program",
    "run": "register a run: a model on two domains, with adjustments",
    "precompute": "compute what is missing for runs and publish it",
    "tui": "open the application on a store",
    "serve": "open the application on a store in a browser",
    "runs": "list the runs of a store with their figures",
    "query": "print the instances that an expression selects",
    "sql": "run a read-only SQL query on the index",
    "gap": "the reality gap of a run, measured and judged",
    "sysid": "the parameters of a simulator from recorded drives, and what they leave",
    "score": "how far heatmaps and reasons are right, where the truth is known",
    "nightly": "the gap of this night: measured, judged, kept in a history, told in files",
    "show": "print a view's numbers as a flat table",
    "export": "write a figure as PNG, SVG or PDF",
    "report": "write selections with their figures as one HTML file",
    "snapshot": "write the application's screen after given keys",
    "verify": "check that a store is complete and undamaged",
    "prune": "remove what no kept generation needs",
    "doctor": "tell what this machine and terminal can do",
}

_TORCH_ENVIRONMENT = {"OMP_WAIT_POLICY": "PASSIVE", "GOMP_SPINCOUNT": "0"}


@interrupts.ended_quietly
def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; gives its exit code: 0, 1 not so, 2 wrong request, 3 inconclusive, 70."""
    for name, value in _TORCH_ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    working_folder.distrust()
    arguments = _with_default_command(list(sys.argv[1:] if argv is None else argv))
    if not _usable(arguments):
        return 2
    if argv is None:
        interrupts.watch(next((word for word in arguments if word in COMMANDS), None))
    with _escaped_streams():
        code = _run(arguments)
    return code if argv is not None else _ended(code)


@contextlib.contextmanager
def _escaped_streams() -> Iterator[None]:
    """Control characters in what is printed are shown escaped: all of standard error, and standard
    output on a terminal. In a pipe standard output holds names as they are.
    """
    from s2rstore.security.printable_text import printable_stream

    with contextlib.ExitStack() as stack:
        stack.enter_context(contextlib.redirect_stderr(printable_stream(sys.stderr)))
        if sys.stdout.isatty():
            stack.enter_context(contextlib.redirect_stdout(printable_stream(sys.stdout)))
        yield


def _run(arguments: list[str]) -> int:
    debug = "--debug" in arguments
    parser = _parser(arguments)
    options = parser.parse_args([word for word in arguments if word != "--debug"])
    options.debug = debug
    if not hasattr(options, "execute"):
        parser.print_help()
        return 2
    return _guarded(options)


def _ended(code: int) -> int:
    """The program's end: nobody waits for what the application left under way."""
    background = sys.modules.get("s2rtui.jobs.background_thread")
    return code if background is None else int(background.end_process(code))


def _usable(arguments: list[str]) -> bool:
    """Whether there is an output to write to and arguments that can be encoded."""
    standard_streams.fill_closed()
    if sys.stdout is None:
        print("s2r: the standard output is closed", file=sys.stderr)
        return False
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError:
            print(f"s2r: argument {argument!a}: not UTF-8", file=sys.stderr)
            return False
    return True


class _Parser(argparse.ArgumentParser):
    """Says in one line what is wrong."""

    def error(self, message: str) -> NoReturn:
        from s2rstore.security.printable_text import printable

        self.exit(2, f"s2r: {printable(message)}; see `{self.prog} --help`\n")


def _with_default_command(arguments: list[str]) -> list[str]:
    """`s2r S.s2r` means `s2r tui S.s2r`; so does a path to anything that exists."""
    words = [word for word in arguments if not word.startswith("-")]
    if not words or words[0] in COMMANDS:
        return arguments
    is_path = words[0].rstrip("/").endswith(".s2r") or os.path.exists(words[0])
    return ["tui", *arguments] if is_path else arguments


def _parser(arguments: list[str]) -> argparse.ArgumentParser:
    parser = _Parser(
        prog="s2r",
        description="Find out where and why pose estimates fail in reality.",
        epilog="`s2r COMMAND --help` tells the rest. `s2r STORE.s2r` opens the application.",
    )
    parser.add_argument("--version", action="version", version=_version())
    commands = parser.add_subparsers(metavar="COMMAND")
    asked = next((word for word in arguments if word in COMMANDS), None)
    for name, help_line in COMMANDS.items():
        command = commands.add_parser(name, help=help_line, description=help_line.capitalize())
        if name == asked:
            module = importlib.import_module(f"s2rtui.cli.commands.{name}")
            command.add_argument("--debug", action="store_true", help="show tracebacks")
            module.add_arguments(command)
            command.set_defaults(execute=module.execute, command=name)
    return parser


def _version() -> str:
    from importlib import metadata

    try:
        return f"s2rtui {metadata.version('s2rtui')}"
    except metadata.PackageNotFoundError:
        return "s2rtui (not installed)"


def _guarded(options: argparse.Namespace) -> int:
    from s2rstore.errors import S2RError
    from s2rstore.security.printable_text import printable

    try:
        code = int(interrupts.interruptible(options) or 0)
        sys.stdout.flush()
        return code
    except S2RError as error:
        if options.debug:
            raise
        print(f"s2r: {_line(error)}", file=sys.stderr)
        return error.exit_code
    except ModuleNotFoundError as error:
        if options.debug or (error.name or "").startswith("s2r"):
            raise
        print(
            f"s2r: this needs {error.name}; install it with `pip install 's2rtui[tools]'`",
            file=sys.stderr,
        )
        return 2
    except KeyboardInterrupt:
        interrupts.tell(options.command)
        return interrupts.CODE
    except MemoryError:
        if options.debug:
            raise
        print("s2r: this needs more memory than there is", file=sys.stderr)
        return 2
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        if options.debug:
            raise
        where = error.filename if error.filename is not None else _failing_output(error)
        reason = str(error.strerror or error)
        print(f"s2r: {printable(f'{where}: {reason}' if where else reason)}", file=sys.stderr)
        return 2
    except Exception as error:
        if options.debug:
            raise
        text = f"{type(error).__name__}: {_line(error)}"
        print(f"s2r: a fault of the program: {text} (--debug shows where)", file=sys.stderr)
        return 70


def _failing_output(error: OSError) -> str:
    """What to name for an error without a file name: standard output, where a command wrote to it.

    What could not be written is dropped, so that the end of the program does not try again.
    """
    innermost = error.__traceback__
    while innermost is not None and innermost.tb_next is not None:
        innermost = innermost.tb_next
    module = "" if innermost is None else str(innermost.tb_frame.f_globals.get("__name__"))
    if not module.startswith("s2rtui.cli"):
        return ""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return "standard output"


def _line(error: Exception) -> str:
    """An error in one printable line."""
    from s2rstore.security.printable_text import printable

    return printable(" ".join(str(error).split()))
