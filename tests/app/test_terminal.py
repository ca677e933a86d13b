"""What is drawn follows from the environment, and unusable terminals are refused with a reason."""

from __future__ import annotations

import pytest

from s2rstore.errors import RequestError
from s2rtui.canvas import ColourMode
from s2rtui.terminal.capabilities import detect, refuse_unusable


@pytest.mark.parametrize(
    ("environment", "mode", "ascii"),
    [
        ({"COLORTERM": "truecolor", "TERM": "xterm-256color"}, ColourMode.TRUECOLOR, False),
        ({"TERM": "xterm-256color", "LANG": "en_US.UTF-8"}, ColourMode.PALETTE, False),
        ({"TERM": "xterm-direct"}, ColourMode.TRUECOLOR, False),
        ({"TERM": "linux"}, ColourMode.ANSI, False),
        ({"TERM": "vt100"}, ColourMode.NONE, False),
        ({"NO_COLOR": "1", "COLORTERM": "truecolor"}, ColourMode.NONE, False),
        ({"TERM": "xterm-256color", "LANG": "C"}, ColourMode.PALETTE, True),
        (
            {"TERM": "xterm-256color", "LANG": "C", "LC_CTYPE": "C.UTF-8"},
            ColourMode.PALETTE,
            True,
        ),
        ({"TERM": "xterm", "LC_ALL": "POSIX", "LANG": "en_US.UTF-8"}, ColourMode.ANSI, True),
    ],
)
def test_environment(environment: dict[str, str], mode: ColourMode, ascii: bool) -> None:
    found = detect(environment=environment)
    assert (found.mode, found.ascii) == (mode, ascii)
    assert found.reason


def test_options_win() -> None:
    found = detect("256", True, {"COLORTERM": "truecolor"})
    assert (found.mode, found.ascii) == (ColourMode.PALETTE, True)


def test_no_terminal_is_refused_with_what_to_do() -> None:
    with pytest.raises(RequestError, match="s2r snapshot"):
        refuse_unusable({"TERM": "xterm"})
