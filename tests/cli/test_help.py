"""Help texts and shell completion scripts."""

import argparse
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bench.support.processes import program_environment
from s2rtui.cli import main
from s2rtui.cli.command_parser import COMMANDS, build_parser
from s2rtui.cli.commands import completion


@pytest.fixture(scope="module")
def parsers() -> dict[tuple[str, ...], argparse.ArgumentParser]:
    return dict(completion._commands(build_parser(COMMANDS)))


@pytest.mark.parametrize("command", COMMANDS)
def test_the_example_of_a_command_is_parsed(command, parsers):
    lines = (parsers[(command,)].epilog or "").splitlines()
    arguments = shlex.split(lines[1].partition(" > ")[0])
    assert arguments[:2] == ["s2r", command]
    assert parsers[()].parse_args(arguments[1:]).command == command


def test_every_argument_is_explained(parsers):
    for path, parser in parsers.items():
        for action in parser._actions:
            if not isinstance(action, argparse._SubParsersAction):
                assert action.help, (path, action.dest)


@pytest.mark.parametrize("command", ["", "gap", "ingest"])
def test_piped_help_has_no_colours(command, capsys):
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    text = capsys.readouterr().out
    assert "\x1b" not in text
    assert "usage: s2r" in text


def _output_on_a_terminal(*arguments: str, **environment: str) -> str:
    primary, secondary = os.openpty()
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "s2rtui", *arguments], stdin=secondary, stdout=secondary,
        env={k: v for k, v in program_environment(TERM="xterm-256color").items()
             if k != "NO_COLOR"} | environment,
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


def test_terminal_help_has_colours_unless_disabled():
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


def test_help_imports_no_heavy_library():
    code = (
        "import sys; from s2rtui.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "assert not {'rich', 'numpy', 'duckdb', 'torch', 'shtab', 'jinja2'} & set(sys.modules)\n"
    )
    command = [sys.executable, "-c", code]
    subprocess.run(command, env=program_environment(), check=True, timeout=60)


_BASH = """
source "$1"
shift
COMP_WORDS=("$@")
COMP_CWORD=$(($# - 1))
COMP_LINE="$*"
COMP_POINT=${#COMP_LINE}
handler=$(complete -p s2r | sed 's/.*-F \\([^ ]*\\).*/\\1/')
"$handler" s2r "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
printf '%s\\n' "${COMPREPLY[@]}"
"""


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("completion")
    paths = {}
    for shell in ("bash", "zsh", "fish"):
        with pytest.MonkeyPatch.context() as patch:
            paths[shell] = folder / shell
            with paths[shell].open("w", encoding="utf-8") as file:
                patch.setattr("sys.stdout", file)
                assert main(["completion", shell]) == 0
    return paths


def _require(shell: str) -> str:
    path = shutil.which(shell)
    if path is None:
        pytest.skip(f"{shell} is not installed")
    return path


def _complete(scripts: dict[str, Path], folder: Path, *words: str) -> set[str]:
    process = subprocess.run(
        [_require("bash"), "--norc", "-c", _BASH, "bash", str(scripts["bash"]), "s2r", *words],
        cwd=folder, capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert process.stderr == ""
    return {line.strip() for line in process.stdout.splitlines()}


def test_bash_completes_commands_options_choices_and_files(scripts, tmp_path):
    (tmp_path / "lab.s2r").mkdir()
    assert set(COMMANDS) <= _complete(scripts, tmp_path, "")
    assert _complete(scripts, tmp_path, "pre") == {"precompute"}
    assert {"--reference", "--golden", "--help"} <= _complete(scripts, tmp_path, "gap", "--")
    assert _complete(scripts, tmp_path, "export", "lab.s2r", "--side", "") == {"sim", "real"}
    assert "add" in _complete(scripts, tmp_path, "model", "")
    assert "--arch" in _complete(scripts, tmp_path, "model", "add", "--a")
    for command in ("gap", "query", "tui"):
        assert _complete(scripts, tmp_path, command, "la") == {"lab.s2r"}
    assert _complete(scripts, tmp_path, "gap", "lab.s2r", "--out", "la") == {"lab.s2r"}


def test_zsh_parses_the_script(scripts):
    assert scripts["zsh"].read_text().startswith("#compdef s2r")
    process = subprocess.run([_require("zsh"), "-n", str(scripts["zsh"])], capture_output=True,
                          text=True, timeout=60, check=False)  # fmt: skip
    assert (process.returncode, process.stderr) == (0, "")


def test_the_fish_script_contains_every_command(scripts):
    text = scripts["fish"].read_text()
    for command in COMMANDS:
        assert f" -a {command} -d " in text
        assert f"__fish_seen_subcommand_from {command}" in text
    for line in text.splitlines():
        assert line.replace("\\'", "").count("'") % 2 == 0


def test_fish_completes_commands_options_choices_and_files(scripts, tmp_path):
    fish = _require("fish")
    (tmp_path / "lab.s2r").mkdir()

    def complete(line: str) -> set[str]:
        code = f"source {scripts['fish']}; complete -C '{line}'"
        process = subprocess.run([fish, "--no-config", "-c", code], cwd=tmp_path, text=True,
                              capture_output=True, timeout=60, check=True)  # fmt: skip
        return {row.split("\t")[0] for row in process.stdout.splitlines()}

    assert set(COMMANDS) <= complete("s2r ")
    assert {"--reference", "--golden"} <= complete("s2r gap --")
    assert complete("s2r export lab.s2r --side ") == {"sim", "real"}
    assert complete("s2r gap la") == {"lab.s2r/"}
