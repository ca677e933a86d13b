"""The shared account: whatever a client asks for, it gets the application or one line."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.support.processes import applications_below, commands_below, wait_until
from bench.support.screen import CTRL_C, CTRL_P, CTRL_Z, ESCAPE, Screen
from bench.support.sshd import Sshd

OpenScreen = Callable[..., Screen]
_SHELLS = {"sh", "bash", "dash", "zsh", "-sh", "-bash"}


def _ran(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, capture_output=True, text=True, timeout=60, stdin=subprocess.DEVNULL
    )


def _files(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "command",
    ["/bin/sh", "cat /etc/passwd", "s2r sql S.s2r 'SELECT 1'", "internal-sftp", ""],
)
def test_without_a_terminal_one_line_refuses(server: Sshd, command: str) -> None:
    asked = [command] if command else []
    done = _ran(server.login(*asked, forced=True, tty=False))
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.count("\n") == 1
    assert "ssh -t" in done.stderr


def test_files_are_neither_fetched_nor_left(server: Sshd, tmp_path: Path) -> None:
    target, left = tmp_path / "fetched", tmp_path / "left"
    mine = tmp_path / "mine"
    mine.write_text("content")
    for program in ("scp", "sftp"):
        done = _ran(server.copy(program, "HOST:/etc/passwd", str(target), forced=True))
        assert done.returncode != 0
    done = _ran(server.copy("scp", str(mine), f"HOST:{left}", forced=True))
    assert done.returncode != 0
    assert not target.exists()
    assert not left.exists()
    assert _ran(server.copy("scp", str(mine), f"HOST:{left}", forced=False)).returncode == 0
    assert left.exists()


def test_nothing_is_forwarded(server: Sshd) -> None:
    def greeting(forced: bool) -> str:
        through = ["-W", f"127.0.0.1:{server.port}"]
        call = server.login(forced=forced, tty=False, options=through)[:-1]
        client = subprocess.Popen(
            call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        try:
            assert client.stdout is not None
            return client.stdout.readline().decode()
        finally:
            client.kill()
            client.communicate()

    assert greeting(forced=False).startswith("SSH-2.0")
    assert greeting(forced=True) == ""


@pytest.mark.parametrize("command", ["/bin/sh", "cat /etc/passwd", ""])
def test_with_a_terminal_the_application_opens(
    server: Sshd, open_screen: OpenScreen, command: str
) -> None:
    asked = [command] if command else []
    screen = open_screen(server.login(*asked, forced=True))
    screen.wait_for("of 40")
    assert b"root:" not in screen.raw
    screen.press("q")
    assert screen.wait_for_end() == 0


def test_no_key_leads_to_a_shell(server: Sshd, open_screen: OpenScreen) -> None:
    screen = open_screen(server.login("/bin/sh", forced=True), (100, 30))
    screen.wait_for("of 40")
    running = applications_below(server.pid)
    for keys in (CTRL_Z, CTRL_C, b"\x1c", b"!", b":", b"~.", b"\x1a\x1a", ESCAPE):
        screen.press(keys)
    screen.press(CTRL_P)
    screen.wait_for("list all keys (?)")
    for word, offer in (("screenshot", "SVG"), ("theme", "current theme"), ("suspend", "Suspend")):
        for length in range(1, len(word) + 1):
            screen.press(word[length - 1])
            screen.wait_for(f"🔎 {word[:length]}")
        assert offer not in screen.text
        screen.press(b"\x15")
        assert offer not in screen.wait_for("Search for commands")
    screen.press(ESCAPE)
    screen.wait_for(lambda text: "🔎" not in text)
    screen.press("c")
    screen.wait_for("│ 40 of 40 │")
    screen.press("w")
    screen.wait_for("│ 6 of 40 │")
    assert applications_below(server.pid) == running
    assert _shells(server) == []
    screen.press("q")
    assert screen.wait_for_end() == 0


@pytest.mark.parametrize("keys", [CTRL_Z, CTRL_C, b"\x1c"], ids=["ctrl-z", "ctrl-c", "ctrl-\\"])
def test_keys_pressed_while_it_starts(server: Sshd, open_screen: OpenScreen, keys: bytes) -> None:
    screen = open_screen(server.login(forced=True))
    assert wait_until(lambda: bool(commands_below(server.pid)))
    limit = time.monotonic() + 30
    while "of 40" not in screen.text and screen.code is None and time.monotonic() < limit:
        screen.press(keys)
        time.sleep(0.02)
    assert "of 40" in screen.text or screen.code is not None
    if screen.code is None:
        screen.press("\n$((40+2))\n")
        screen.press("c")
        screen.wait_for("│ 40 of 40 │")
    assert b"42: " not in screen.raw
    assert _shells(server) == []


def test_models_are_neither_offered_nor_loaded(server: Sshd, open_screen: OpenScreen) -> None:
    screen = open_screen(server.login(forced=True), (200, 60))
    screen.wait_for("3 instance")
    assert "adjust" not in screen.lines[-1]
    for key, action in {"a": "adjust images live", "S": "save the adjustments"}.items():
        screen.press(key)
        screen.wait_for(f"not in a restricted session: {action}")
    screen.press("?")
    assert "adjust images live" not in screen.wait_for("all other instances").replace(
        "not in a restricted session: adjust images live", ""
    )


def test_pictures_go_to_the_users_own_folder_and_nowhere_else(
    server: Sshd, tiny_store: Path, open_screen: OpenScreen
) -> None:
    before = _files(tiny_store)
    screen = open_screen(server.login(forced=True), (100, 30))
    screen.wait_for("of 40")
    screen.press("s")
    screen.wait_for("wrote")
    screen.press("q")
    assert screen.wait_for_end() == 0
    assert _files(tiny_store) == before
    assert (server.data_home / "s2rtui" / "s2r-001.png").is_file()
    assert [path.name for path in server.data_home.iterdir()] == ["s2rtui"]


def _shells(server: Sshd) -> list[list[str]]:
    """Shells below the server that wait for a user; one that runs the forced command does not."""
    return [
        words
        for words in commands_below(server.pid).values()
        if words and Path(words[0]).name in _SHELLS and "-c" not in words
    ]
