"""A restricted process: forbidden calls raise, and environment variables cannot re-enable them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from s2rtui.security.restricted_process import WEB_DRIVER, clean_environment
from tests.support.terminals import open_application

_RESTRICTED_SCRIPT = """
import json, os, socket, subprocess, sys
from pathlib import Path
from s2rtui.security import Permissions
from s2rtui.security.restricted_process import restrict_process
store, own, beside = map(Path, sys.argv[1:4])
restrict_process(Permissions(store, own, True))
(own / "mine.png").write_bytes(b"1")
(own / "mine.png").rename(own / "still-mine.png")
(own / "folder").mkdir()
open(os.devnull, "w").close()
def answer(statement):
    try:
        exec(statement)
        told = "done"
    except (PermissionError, ImportError) as error:
        told = str(error)
    print(json.dumps([statement, told]), flush=True)
"""
FORBIDDEN = [
    "open(beside / 'a', 'w')",
    "open(beside / 'a', 'rb+')",
    "os.open(beside / 'a', os.O_CREAT | os.O_RDWR)",
    "open(store / 'CURRENT.json', 'a')",
    "open(own / '..' / 'a', 'x')",
    "os.mkdir(beside / 'a')",
    "os.rename(own / 'still-mine.png', beside / 'a')",
    "os.remove(store / 'CURRENT.json')",
    "os.symlink(beside, own / 'out')",
    "os.chmod(store, 0o777)",
    "subprocess.run(['/bin/true'])",
    "os.system('true')",
    "os.execv('/bin/true', ['true'])",
    "os.posix_spawn('/bin/true', ['true'], {})",
    "os.fork()",
    "__import__('pty').spawn('/bin/sh')",
    "socket.create_connection(('127.0.0.1', 22), 1)",
    "socket.socket().bind(('127.0.0.1', 0))",
    "__import__('torch')",
    "__import__('s2rtools.models')",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Contains a store, a user data folder and another folder."""
    root = tmp_path_factory.mktemp("confined")
    for name in ("own", "store", "beside"):
        (root / name).mkdir()
    (root / "store" / "CURRENT.json").write_text("{}")
    return root


@pytest.fixture(scope="module")
def answers(folder: Path) -> dict[str, str]:
    """The error that a restricted process raises for each forbidden statement."""
    code = f"{_RESTRICTED_SCRIPT}\nfor statement in {FORBIDDEN!r}:\n    answer(statement)\n"
    folders = [str(folder / name) for name in ("store", "own", "beside")]
    process = subprocess.run(
        [sys.executable, "-c", code, *folders], capture_output=True, text=True, check=True
    )
    return dict(json.loads(line) for line in process.stdout.splitlines())


@pytest.mark.parametrize("statement", FORBIDDEN)
def test_forbidden_statements_raise(answers, folder, statement):
    assert "restricted" in answers[statement]
    assert list((folder / "beside").iterdir()) == []
    assert (folder / "store" / "CURRENT.json").read_text() == "{}"


def test_dangerous_variables_are_removed():
    environment = {
        "TEXTUAL": "devtools,debug", "TEXTUAL_LOG": "/tmp/log", "TEXTUAL_DRIVER": "evil:Driver",
        "TEXTUAL_PRESS": "w", "TEXTUAL_SCREENSHOT": "1", "PATH": "/bin",
    }  # fmt: skip
    clean_environment(environment)
    assert environment == {"PATH": "/bin"}
    web_environment = {"TEXTUAL_DRIVER": WEB_DRIVER, "TEXTUAL_LOG": "/tmp/log"}
    clean_environment(web_environment)
    assert web_environment == {"TEXTUAL_DRIVER": WEB_DRIVER}


def test_the_application_works_in_a_restricted_process(tiny_store, tmp_path):
    variables = {
        "TEXTUAL_LOG": str(tmp_path / "log"), "TEXTUAL_SCREENSHOT": "0",
        "TEXTUAL_SCREENSHOT_LOCATION": str(tmp_path), "TEXTUAL_PRESS": "q",
        "TEXTUAL_DRIVER": "nowhere:Driver",
    }  # fmt: skip
    share, size = tmp_path / "data", (160, 45)
    screen = open_application(tiny_store, share, "--restricted", size=size, **variables)
    try:
        screen.wait_for("any key begins")
        screen.press(" ")
        screen.wait_for("3 instance")
        screen.press("c")
        screen.wait_for("│ 40 of 40 │")
        for keys in ("w", "h", "v", "o", "o", "m", "+", "0", "r", "n", "y", "?"):
            screen.press(keys)
        screen.wait_for("all other instances")
        screen.press("\x1b")
        screen.wait_for("3 instance")
        screen.press("tt")
        screen.press("c")
        screen.wait_for("of 15")
        screen.press("s")
        screen.wait_for("wrote")
        screen.press("@")
        screen.wait_for("a name for this selection")
        screen.press("mine\r")
        screen.wait_for("saved as @mine")
        screen.press("q")
        assert screen.wait_for_end() == 0
    finally:
        screen.close()
    written = [path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file()]
    assert Path("data/s2rtui/s2r-001.png") in written
    (notebook,) = (tmp_path / "data" / "s2rtui").glob("*.json")
    content = json.loads(notebook.read_text())
    assert "mine" in content["selections"]
    assert content["history"]
    assert {path.parts[:2] for path in written} == {("data", "s2rtui")}
