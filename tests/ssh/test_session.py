"""Sessions over SSH: login, keys, sizes, colours, lost connections and tmux."""

import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator

import pytest

from bench.support.processes import applications_below, is_alive, wait_until
from bench.support.sshd import Sshd, application

_COLOUR = re.compile(rb"\x1b\[(?:[0-9;]*;)?(?:[34][0-8]|9[0-7]|10[0-7])(?:;[0-9;]*)?m")


def test_the_application_runs_from_a_login_shell(server, tiny_store, open_screen):
    screen = open_screen(server.login(), (100, 30))
    screen.press(shlex.join(application(tiny_store)) + "; echo left with $?\n")
    screen.wait_for("of 40")
    screen.press("q")
    screen.wait_for("left with 0")
    screen.press("exit\n")
    assert screen.wait_for_end() == 0


def test_resizing_changes_the_layout(server, tiny_store, open_screen):
    screen = open_screen(server.login(*application(tiny_store)), (80, 24))
    screen.wait_for("2 map")
    assert "1 overview" not in screen.text
    screen.resize(200, 60)
    names = ("1 overview", "2 map", "3 instance", "errors")
    screen.wait_for(
        lambda text: all(name in text for name in names) and max(map(len, text.splitlines())) > 150
    )
    screen.resize(30, 8)
    screen.wait_for("too small")
    screen.resize(80, 24)
    screen.wait_for(lambda text: "2 map" in text and "3 instance" not in text)


@pytest.mark.parametrize(
    ("environment", "coloured", "truecolour"),
    [
        ({"TERM": "xterm-256color", "COLORTERM": "truecolor"}, True, True),
        ({"TERM": "xterm-256color"}, True, False),
        ({"TERM": "xterm-256color", "COLORTERM": "truecolor", "NO_COLOR": "1"}, False, False),
    ],
    ids=["truecolour", "256", "NO_COLOR"],
)
def test_colours_are_those_of_the_user_s_terminal(
    server, tiny_store, open_screen, environment, coloured, truecolour
):
    screen = open_screen(server.login(*application(tiny_store)), (100, 30), environment)
    screen.press("c")
    screen.wait_for("│ 40 of 40 │")
    screen.press("w")
    screen.wait_for("│ 6 of 40 │")
    assert bool(_COLOUR.search(screen.raw)) == coloured
    assert (b"38;2;" in screen.raw or b"48;2;" in screen.raw) == truecolour


def test_a_dumb_terminal_is_rejected_with_the_reason(server, tiny_store, open_screen):
    screen = open_screen(server.login(*application(tiny_store)), (200, 24), {"TERM": "dumb"})
    assert screen.wait_for_end() == 2
    assert "TERM=dumb" in screen.text
    assert b"\x1b" not in screen.raw


def test_a_lost_connection_leaves_nothing_running(server, tiny_store, open_screen):
    screen = open_screen(server.login(*application(tiny_store)))
    screen.wait_for("of 40")
    running = applications_below(server.pid)
    assert len(running) == 1
    screen.kill()
    assert wait_until(lambda: not is_alive(running[0]))


@pytest.fixture
def tmux(server: Sshd) -> Iterator[list[str]]:
    """The tmux command with a separate server, which ends with the test."""
    if shutil.which("tmux") is None:
        pytest.skip("tmux is not installed")
    command = ["tmux", "-u", "-S", str(server.folder / "tmux"), "-f", "/dev/null"]
    yield command
    subprocess.run([*command, "kill-server"], capture_output=True)


def test_tmux_keeps_the_session_when_the_connection_is_cut(server, tiny_store, open_screen, tmux):
    command = [*tmux, "new-session", "-A", "-s", "work", shlex.join(application(tiny_store))]
    before = open_screen(server.login(*command), (80, 24))
    before.wait_for("of 40")
    before.press("c")
    before.wait_for("│ 40 of 40 │")
    before.press("w")
    before.wait_for("│ 6 of 40 │")
    before.press("b")
    before.wait_for("best15")
    before.kill()
    after = open_screen(server.login(*command), (160, 45))
    expected = ("│ 6 of 40 │", "best15", "1 overview", "3 instance")
    after.wait_for(lambda text: all(part in text for part in expected))
    after.press("u")
    after.wait_for("worst15")
    after.press("q")
    assert after.wait_for_end() == 0
