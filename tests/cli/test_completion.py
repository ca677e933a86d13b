"""Shell completion scripts, executed in the installed shells."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from s2rtui.cli import main
from s2rtui.cli.command_parser import COMMANDS

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


def test_bash_completes_commands_options_choices_and_files(
    scripts: dict[str, Path], tmp_path: Path
) -> None:
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


def test_zsh_parses_the_script(scripts: dict[str, Path]) -> None:
    assert scripts["zsh"].read_text().startswith("#compdef s2r")
    process = subprocess.run([_require("zsh"), "-n", str(scripts["zsh"])], capture_output=True,
                          text=True, timeout=60, check=False)  # fmt: skip
    assert (process.returncode, process.stderr) == (0, "")


def test_the_fish_script_contains_every_command(scripts: dict[str, Path]) -> None:
    text = scripts["fish"].read_text()
    for command in COMMANDS:
        assert f" -a {command} -d " in text
        assert f"__fish_seen_subcommand_from {command}" in text
    for line in text.splitlines():
        assert line.replace("\\'", "").count("'") % 2 == 0


def test_fish_completes_commands_options_choices_and_files(
    scripts: dict[str, Path], tmp_path: Path
) -> None:
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
