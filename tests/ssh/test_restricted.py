"""The restricted account: every request gets the application or a one-line error."""

import subprocess
import time
from pathlib import Path

import pytest

from bench.support.processes import applications_below, commands_below, wait_until
from bench.support.screen import CTRL_C, CTRL_P, CTRL_Z, ESCAPE
from bench.support.sshd import Sshd

_SHELLS = {"sh", "bash", "dash", "zsh", "-sh", "-bash"}


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, capture_output=True, text=True, timeout=300, stdin=subprocess.DEVNULL
    )


@pytest.mark.parametrize("command", ["/bin/sh", "s2r sql S.s2r 'SELECT 1'", "internal-sftp", ""])
def test_without_a_terminal_every_command_is_rejected(server, command):
    arguments = [command] if command else []
    process = _run(server.login(*arguments, forced=True, tty=False))
    assert process.returncode == 2
    assert process.stdout == ""
    assert process.stderr.count("\n") == 1
    assert "ssh -t" in process.stderr


def test_files_cannot_be_copied(server, tmp_path):
    target, uploaded = tmp_path / "fetched", tmp_path / "left"
    local_file = tmp_path / "mine"
    local_file.write_text("content")
    for program in ("scp", "sftp"):
        process = _run(server.copy(program, "HOST:/etc/passwd", str(target), forced=True))
        assert process.returncode != 0
    process = _run(server.copy("scp", str(local_file), f"HOST:{uploaded}", forced=True))
    assert process.returncode != 0
    assert not target.exists()
    assert not uploaded.exists()
    assert (
        _run(server.copy("scp", str(local_file), f"HOST:{uploaded}", forced=False)).returncode == 0
    )
    assert uploaded.exists()


def test_port_forwarding_is_disabled(server):
    def greeting(forced: bool) -> str:
        forward_option = ["-W", f"127.0.0.1:{server.port}"]
        command = server.login(forced=forced, tty=False, options=forward_option)[:-1]
        client = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        try:
            return client.stdout.readline().decode()
        finally:
            client.kill()
            client.communicate()

    assert greeting(forced=False).startswith("SSH-2.0")
    assert greeting(forced=True) == ""


@pytest.mark.parametrize("command", ["cat /etc/passwd", ""])
def test_with_a_terminal_every_command_opens_the_application(server, open_screen, command):
    arguments = [command] if command else []
    screen = open_screen(server.login(*arguments, forced=True))
    screen.wait_for("of 40")
    assert b"root:" not in screen.raw
    screen.press("q")
    assert screen.wait_for_end() == 0


def test_no_key_opens_a_shell(server, open_screen):
    screen = open_screen(server.login("/bin/sh", forced=True), (100, 30))
    screen.wait_for("of 40")
    running = applications_below(server.pid)
    for keys in (CTRL_Z, CTRL_C, b"\x1c", b"!", b":", b"~.", b"\x1a\x1a", ESCAPE):
        screen.press(keys)
    screen.press(CTRL_P)
    screen.wait_for("add the next selection (|)")
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
def test_keys_during_startup_open_no_shell(server, open_screen, keys):
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


def _shells(server: Sshd) -> list[list[str]]:
    """Interactive shells below the server; shells that run the forced command are excluded."""
    return [
        command_line
        for command_line in commands_below(server.pid).values()
        if command_line and Path(command_line[0]).name in _SHELLS and "-c" not in command_line
    ]
