"""Terminal detection from the environment, and rejection of unusable terminals with a reason."""

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
        ({"TERM": "xterm-256color", "LANG": "C", "LC_CTYPE": "C.UTF-8"}, ColourMode.PALETTE, True),
        ({"TERM": "xterm", "LC_ALL": "POSIX", "LANG": "en_US.UTF-8"}, ColourMode.ANSI, True),
    ],
)
def test_the_environment_determines_the_colour_mode(
    environment: dict[str, str], mode: ColourMode, ascii: bool
) -> None:
    detected = detect(environment=environment)
    assert (detected.mode, detected.ascii) == (mode, ascii)
    assert detected.reason


def test_options_override_the_environment() -> None:
    detected = detect("256", True, {"COLORTERM": "truecolor"})
    assert (detected.mode, detected.ascii) == (ColourMode.PALETTE, True)


def test_a_missing_terminal_is_rejected_with_advice() -> None:
    with pytest.raises(RequestError, match="s2r snapshot"):
        refuse_unusable({"TERM": "xterm"})
