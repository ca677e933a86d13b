"""The argument parser of `s2r` and its `--help`; a command's module is imported when it is used."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Callable, Collection
from typing import Any, NamedTuple, NoReturn, cast

COMMANDS: dict[str, str] = {
    "demo": "build a demo store from the synthetic world or your images, and open it",
    "ingest": "create a store from paired images or from the synthetic world",
    "train": "train a model with a recipe and register a run of it",
    "model": "register a weights file or the pretrained models",
    "run": "register a run of a model, or import predictions as a run",
    "translate": "fit, apply and judge translators between sim and real images",
    "precompute": "compute the missing predictions and heatmaps of runs",
    "tui": "open the terminal application on a store",
    "serve": "serve the application on a store to web browsers",
    "mcp": "serve a store to agents by the Model Context Protocol",
    "models": "list the models of a store and how images become their input",
    "runs": "list the runs of a store with their accuracies and errors",
    "findings": "print what a store shows about a run, with evidence",
    "evaluate": "say what real images decide about a run, what simulation adds, and what to add",
    "render": "render sim frames at new poses with your own simulator",
    "collect": "choose where to take new real images, for a fixed number of them",
    "labels": "import label images, which name the objects that images show",
    "objects": "rank labelled objects by the metres that they cost the real prediction",
    "query": "list the instances that an expression selects",
    "sql": "run a read-only SQL query on the index of a store",
    "gap": "measure the reality gap of a run and judge it",
    "sysid": "identify the parameters of a simulator from recorded drives",
    "score": "score heatmaps and causes against ground truth",
    "suggest": "search the smallest change of images or simulator that closes the gap",
    "ros": "translate the camera images of ROS topics or of a bag",
    "nightly": "measure and judge the gap of one night; update history and reports",
    "show": "print the numbers of a view as a table",
    "export": "write a figure, or files for Rerun, Foxglove, evo, FiftyOne or COCO",
    "import": "take notes and tags of instances from a CSV file",
    "report": "write selections with their figures to one HTML file",
    "snapshot": "write a screenshot of the application after a sequence of keys",
    "check": "find and record faults of images, poses and times, such as blur and frozen frames",
    "verify": "check that a store is complete and undamaged",
    "push": "copy the published generation of a store to object storage",
    "rooms": "list the rooms of a store, or rename one",
    "prune": "delete files that no recent generation of a store needs",
    "doctor": "report what this machine and this terminal support",
    "completion": "print a completion script for bash, zsh or fish",
}
_TOOLS = {
    "ingest": "datasets",
    "train": "training",
    "run": "prediction_import",
    "precompute": "precompute",
    "labels": "labels",
    "render": "simulated_frames",
    "gap": "gap",
    "sysid": "sysid",
    "score": "scoring",
    "ros": "ros",
    "nightly": "nightly",
}
"""Commands whose module is `command` of a package of s2rtools."""
_SHARED = {
    "collect": "extended_tools",
    "suggest": "extended_tools",
    "translate": "extended_tools",
    "import": "notes_import",
    "model": "models",
    "models": "models",
    "prune": "maintenance",
    "push": "maintenance",
    "rooms": "maintenance",
    "verify": "maintenance",
}
"""Modules of `cli.commands` with several commands; any other command is a module of its name."""
_HELP_COLUMN = 28
_COMMAND_WIDTH = 16
"""Width reserved for the names of commands, which argparse indents after it has measured them."""


class CommandParser(argparse.ArgumentParser):
    """Parser with one-line errors, and help in colours on a terminal."""

    def __init__(self, *args: object, **settings: object) -> None:
        settings["formatter_class"] = _plain_formatter
        super().__init__(*args, **settings)  # type: ignore[arg-type]
        self._positionals.title = "arguments"

    def error(self, message: str) -> NoReturn:
        from s2rstore.security.printable_text import printable

        self.exit(2, f"s2r: {printable(message)}; see `{self.prog} --help`\n")

    def print_help(self, file: Any = None) -> None:
        """Print the help: with colours on a terminal unless NO_COLOR is set, else plain."""
        stream = file or sys.stdout
        dumb = os.environ.get("TERM") == "dumb" or os.environ.get("NO_COLOR")
        if dumb or not stream.isatty():
            super().print_help(file)
            return
        from rich_argparse import RawDescriptionRichHelpFormatter

        from s2rstore.security.printable_text import underlying_stream

        class ColouredFormatter(RawDescriptionRichHelpFormatter):
            help_markup = text_markup = False

            def __init__(self, prog: str) -> None:
                super().__init__(prog, max_help_position=_HELP_COLUMN)
                self._action_max_length = _COMMAND_WIDTH

        self.formatter_class = ColouredFormatter
        try:
            print(self.format_help(), end="", file=underlying_stream(stream))
        finally:
            self.formatter_class = _plain_formatter


def _plain_formatter(prog: str) -> argparse.HelpFormatter:
    formatter = argparse.RawDescriptionHelpFormatter(prog, max_help_position=_HELP_COLUMN)
    formatter._action_max_length = _COMMAND_WIDTH
    return formatter


class Command(NamedTuple):
    """A command: an example for its help, the function that adds its arguments, and what it does.

    `execute` gets the parsed options and returns the exit code.
    """

    example: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    execute: Callable[[argparse.Namespace], int]


def load_command(name: str) -> Command:
    """Import a command.

    A module of several commands has them in `COMMANDS`, by name; a module of one command has
    `EXAMPLE`, `add_arguments` and `execute`.
    """
    if name in _SHARED:
        shared = importlib.import_module(f"s2rtui.cli.commands.{_SHARED[name]}")
        return cast(Command, shared.COMMANDS[name])
    package = _TOOLS.get(name)
    path = f"s2rtools.{package}.command" if package else f"s2rtui.cli.commands.{name}"
    module = importlib.import_module(path)
    return Command(module.EXAMPLE, module.add_arguments, module.execute)


def build_parser(commands: Collection[str] = ()) -> CommandParser:
    """Return the parser of `s2r`; only those `commands` get their arguments."""
    parser = CommandParser(
        prog="s2r",
        description="Find out where and why a robot's pose estimates fail in reality.",
        epilog="Examples:\n"
        "  s2r demo                  build the demo store and open it\n"
        "  s2r STORE.s2r             open the application on a store\n"
        "  s2r COMMAND --help        show the options of a command",
    )
    parser.add_argument("--version", action="version", version=_version())
    subparsers = parser.add_subparsers(metavar="COMMAND", title="commands")
    for name, summary in COMMANDS.items():
        if name not in commands:
            subparsers.add_parser(name, help=summary)
            continue
        command = load_command(name)
        subparser = subparsers.add_parser(
            name,
            help=summary,
            description=_sentence(summary),
            epilog=f"Example:\n  {command.example}",
        )
        subparser.add_argument(
            "--debug", action="store_true", help="show the traceback of an unexpected error"
        )
        subparser.add_argument(
            "--no-plugins", action="store_true", help="use no parts of other installed packages"
        )
        command.add_arguments(subparser)
        subparser.set_defaults(execute=command.execute, command=name, parser=subparser)
        for actions in subparser._actions:
            if isinstance(actions, argparse._SubParsersAction):
                for entry in actions._choices_actions:
                    actions.choices[entry.dest].description = _sentence(entry.help or "")
    return parser


def _sentence(summary: str) -> str:
    return f"{summary[:1].upper()}{summary[1:]}."


def _version() -> str:
    from importlib import metadata

    try:
        return f"s2rtui {metadata.version('s2rtui')}"
    except metadata.PackageNotFoundError:
        return "s2rtui (not installed)"
