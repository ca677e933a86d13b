"""Detection of terminals and the options `--theme`, `--symbols` and `--remember`."""

import argparse
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rtui.canvas import DARK, LIGHT, THEMES, ColourMode
from s2rtui.canvas.block_symbols import SYMBOL_SETS
from s2rtui.cli.display_arguments import (
    SYMBOL_NAMES,
    THEME_NAMES,
    add_display_options,
    detect_display,
    size_argument,
)
from s2rtui.terminal.capabilities import Terminal, detect, refuse_unusable
from s2rtui.user_data.display_settings import (
    DisplaySettings,
    read_settings,
    settings_path,
    write_settings,
)


@pytest.fixture(autouse=True)
def own_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    monkeypatch.delenv("COLORFGBG", raising=False)
    monkeypatch.delenv("TMUX", raising=False)
    return tmp_path


def display(*words: str) -> Terminal:
    parser = argparse.ArgumentParser()
    add_display_options(parser)
    return detect_display(parser.parse_args(words), "256")


@pytest.mark.parametrize(
    ("value", "theme"),
    [("15;0", DARK), ("0;15", LIGHT), ("0;default;15", LIGHT), ("default;default", DARK),
     (";", DARK), ("0;99", DARK)],
)  # fmt: skip
def test_colorfgbg_tells_a_light_background(value, theme):
    assert detect(environment={"TERM": "xterm", "COLORFGBG": value}).theme is theme


def test_options_override_the_environment():
    environment = {"TERM": "xterm", "COLORFGBG": "0;15"}
    assert detect(environment=environment, theme="dark").theme is DARK
    assert detect(environment={}, theme="light").theme is LIGHT
    detected = detect("256", True, {"COLORTERM": "truecolor"})
    assert (detected.mode, detected.ascii) == (ColourMode.PALETTE, True)
    assert detect(environment={"TMUX": "/tmp/tmux,1,0"}, symbols="octant").symbols == "sextant"
    assert detect(environment={}, symbols="octant").symbols == "octant"


def test_options_name_all_themes_and_symbols():
    assert {*THEME_NAMES} == {"auto", *THEMES}
    assert {*SYMBOL_NAMES} == {*SYMBOL_SETS}


def test_remembered_options_are_used_until_others_are_given():
    first = display("--theme", "light", "--symbols", "octant", "--remember")
    assert first.render_options.theme is LIGHT
    assert display().render_options.symbols == "octant"
    assert display("--symbols", "half").render_options.symbols == "half"
    assert display().theme is LIGHT
    display("--theme", "auto", "--remember")
    assert display().theme is DARK
    assert display().symbols == "octant"


@pytest.mark.parametrize(
    "content", ["", "[]", "{", '{"theme": 3, "symbols": ["octant"]}', '{"theme": "blue"}']
)
def test_damaged_settings_count_as_none(content):
    settings_path().parent.mkdir(parents=True)
    settings_path().write_text(content)
    assert display().theme is DARK
    assert display().symbols == "quadrant"


def test_settings_that_cannot_be_written_are_a_request_error(own_data_folder):
    (own_data_folder / "s2rtui").write_text("in the way")
    with pytest.raises(RequestError, match=r"display\.json"):
        write_settings(DisplaySettings("light"))
    assert read_settings() == DisplaySettings()


@pytest.mark.parametrize(
    ("environment", "mode", "ascii"),
    [
        ({"COLORTERM": "truecolor", "TERM": "xterm-256color"}, ColourMode.TRUECOLOR, False),
        ({"TERM": "xterm-direct"}, ColourMode.TRUECOLOR, False),
        ({"TERM": "linux"}, ColourMode.ANSI, False),
        ({"TERM": "vt100"}, ColourMode.NONE, False),
        ({"NO_COLOR": "1", "COLORTERM": "truecolor"}, ColourMode.NONE, False),
        ({"TERM": "xterm-256color", "LANG": "C", "LC_CTYPE": "C.UTF-8"}, ColourMode.PALETTE, True),
        ({"TERM": "xterm", "LC_ALL": "POSIX", "LANG": "en_US.UTF-8"}, ColourMode.ANSI, True),
    ],
)
def test_the_environment_determines_the_colour_mode(environment, mode, ascii):
    detected = detect(environment=environment)
    assert (detected.mode, detected.ascii) == (mode, ascii)
    assert detected.reason


def test_a_missing_terminal_is_rejected_with_advice():
    with pytest.raises(RequestError, match="s2r snapshot"):
        refuse_unusable({"TERM": "xterm"})


@pytest.mark.parametrize("text", ["", "10", "10x", "0x20", "10x20x30", "-10x20", "1000x20"])
def test_wrong_sizes_are_refused(text):
    with pytest.raises(RequestError, match="must be pixels of a cell from 4x4 to 100x200"):
        size_argument("--cell-size", text, (4, 4), (100, 200), "pixels of a cell")
