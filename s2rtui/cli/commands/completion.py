"""`s2r completion`: print a script that completes commands, options, choices and files."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from s2rtui.cli.command_parser import COMMANDS, build_parser

EXAMPLE = "s2r completion bash > ~/.local/share/bash-completion/completions/s2r"
SHELLS = ("bash", "zsh", "fish")
_PATH_ARGUMENTS = ("store", "drives")
"""Arguments that are paths although they are parsed as text."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, help="shell that will read the script")
    parser.epilog = (
        "Installation:\n"
        f"  {EXAMPLE}\n"
        "  s2r completion zsh > ~/.zfunc/_s2r         (with `fpath+=~/.zfunc` before `compinit`)\n"
        "  s2r completion fish > ~/.config/fish/completions/s2r.fish"
    )


def execute(options: argparse.Namespace) -> int:
    parser = build_parser(COMMANDS)
    if options.shell == "fish":
        print("\n".join(_fish_script(parser)))
        return 0
    import shtab

    for _, command in _commands(parser):
        for action in command._actions:
            if _is_path(action):
                action.complete = shtab.FILE  # type: ignore[attr-defined]
    print(shtab.complete(parser, options.shell))
    return 0


def _commands(
    parser: argparse.ArgumentParser, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], argparse.ArgumentParser]]:
    """Yield a parser and all its subparsers with the command words that lead to them."""
    yield path, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command in action.choices.items():
                yield from _commands(command, (*path, name))


def _is_path(action: argparse.Action) -> bool:
    return action.type is Path or action.dest in _PATH_ARGUMENTS


def _fish_script(root: argparse.ArgumentParser) -> Iterator[str]:
    """Yield the lines of the script for fish, which shtab does not support.

    A line applies to the command words before the cursor: the path of a subparser must have been
    typed, and none of its subcommands.
    """
    yield "complete -c s2r -f"
    for path, parser in _commands(root):
        subcommands: dict[str, str] = {}
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                subcommands = {a.dest: a.help or "" for a in action._choices_actions}
        condition = "; and ".join(f"__fish_seen_subcommand_from {word}" for word in path)
        if subcommands:
            excluded = f"not __fish_seen_subcommand_from {' '.join(subcommands)}"
            condition = f"{condition}; and {excluded}" if condition else excluded
        prefix = f"complete -c s2r -n {_fish_quoted(condition)}"
        for name, summary in subcommands.items():
            yield f"{prefix} -a {name} -d {_fish_quoted(summary)}"
        for action in parser._actions:
            if not isinstance(action, argparse._SubParsersAction) and _fish_argument(action):
                yield prefix + _fish_argument(action)


def _fish_argument(action: argparse.Action) -> str:
    """Return the options of `complete` for one argument."""
    settings = "".join(
        f" -l {name[2:]}" if name.startswith("--") else f" -s {name[1:]}"
        for name in action.option_strings
    )
    if action.option_strings and action.nargs != 0:
        settings += " -r"
    if action.choices is not None:
        settings += f" -a {_fish_quoted(' '.join(map(str, action.choices)))}"
    elif _is_path(action):
        settings += " -F"
    if action.help and action.option_strings:
        summary = action.help % {**vars(action), "prog": "s2r"}
        settings += f" -d {_fish_quoted(summary)}"
    return settings


def _fish_quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"
