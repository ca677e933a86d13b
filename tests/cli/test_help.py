"""Help texts: valid examples, named argument groups, and colours only on a terminal."""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys

import pytest

from s2rtui.cli import main
from s2rtui.cli.command_parser import COMMANDS, build_parser
from s2rtui.cli.commands import completion


@pytest.fixture(scope="module")
def parsers() -> dict[tuple[str, ...], argparse.ArgumentParser]:
    return dict(completion._commands(build_parser(COMMANDS)))


@pytest.mark.parametrize("command", COMMANDS)
def test_the_example_of_a_command_is_parsed(
    command: str, parsers: dict[tuple[str, ...], argparse.ArgumentParser]
) -> None:
    lines = (parsers[(command,)].epilog or "").splitlines()
    arguments = shlex.split(lines[1].partition(" > ")[0])
    assert arguments[:2] == ["s2r", command]
    assert parsers[()].parse_args(arguments[1:]).command == command


def test_every_argument_is_explained(
    parsers: dict[tuple[str, ...], argparse.ArgumentParser],
) -> None:
    for path, parser in parsers.items():
        for action in parser._actions:
            if not isinstance(action, argparse._SubParsersAction):
                assert action.help, (path, action.dest)


@pytest.mark.parametrize("command", ["", "gap", "ingest"])
def test_piped_help_has_no_colours(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    text = capsys.readouterr().out
    assert "\x1b" not in text
    assert "usage: s2r" in text


def _output_on_a_terminal(*arguments: str, **environment: str) -> str:
    primary, secondary = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "s2rtui", *arguments], stdin=secondary, stdout=secondary,
        env={**{k: v for k, v in os.environ.items() if k != "NO_COLOR"},
             "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), "TERM": "xterm-256color",
             **environment},
    )  # fmt: skip
    os.close(secondary)
    chunks = []
    try:
        while chunk := os.read(primary, 65536):
            chunks.append(chunk)
    except OSError:
        pass
    finally:
        os.close(primary)
    assert process.wait(30) == 0
    return b"".join(chunks).decode()


def test_terminal_help_has_colours_unless_disabled() -> None:
    coloured = _output_on_a_terminal("gap", "--help")
    assert "\x1b[" in coloured
    assert "\\x1b" not in coloured
    assert "--freeze-golden" in coloured
    for plain in (
        _output_on_a_terminal("gap", "--help", NO_COLOR="1"),
        _output_on_a_terminal("gap", "--help", TERM="dumb"),
    ):
        assert "\x1b" not in plain
        assert "--freeze-golden" in plain


def test_help_imports_no_heavy_library() -> None:
    code = (
        "import sys; from s2rtui.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "assert not {'rich', 'numpy', 'duckdb', 'torch', 'shtab', 'jinja2'} & set(sys.modules)\n"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    subprocess.run([sys.executable, "-c", code], env=environment, check=True, timeout=60)
