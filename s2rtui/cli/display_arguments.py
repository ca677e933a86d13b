"""The options `--theme` and `--symbols`, and the settings that they default to.

`--theme auto|dark|light` is the same in all commands that draw; `auto` is explained by each.
"""

from __future__ import annotations

import argparse
import re
from typing import TYPE_CHECKING, Any, cast

from s2rstore.errors import RequestError

if TYPE_CHECKING:
    from s2rtui.canvas.block_symbols import Symbols
    from s2rtui.terminal.capabilities import Terminal

THEME_NAMES = ("auto", "dark", "light")
SYMBOL_NAMES = ("half", "quadrant", "sextant", "octant")
_SYMBOLS_HELP = (
    "block characters of floor plans; sextants and octants are finer, but few fonts have them: "
    "`s2r doctor` shows samples"
)


def add_theme(parser: argparse._ActionsContainer, auto: str, default: str = "auto") -> None:
    """Add `--theme`; the text `auto` explains its value `auto` in the help."""
    parser.add_argument("--theme", choices=THEME_NAMES, default=default,
                        help=f"colours for a dark or a light background; auto: {auto} (default "
                        f"{default})")  # fmt: skip


def add_display_options(parser: argparse.ArgumentParser) -> None:
    """Add `--theme`, `--symbols` and `--remember`."""
    add = parser.add_argument_group("display").add_argument
    add("--theme", choices=THEME_NAMES,
        help="colours for a dark or a light background; auto reads COLORFGBG, else dark "
        "(default: as remembered, else auto)")  # fmt: skip
    add("--symbols", choices=SYMBOL_NAMES,
        help=f"{_SYMBOLS_HELP} (default: as remembered, else quadrant)")  # fmt: skip
    add("--remember", action="store_true",
        help="use this --theme and --symbols from now on")  # fmt: skip


def add_symbols(parser: argparse._ActionsContainer) -> None:
    """Add `--symbols` alone, without settings."""
    parser.add_argument("--symbols", choices=SYMBOL_NAMES, default="quadrant",
                        help=f"{_SYMBOLS_HELP} (default quadrant)")  # fmt: skip


def size_argument(
    option: str, text: str, lowest: tuple[int, int], largest: tuple[int, int], meaning: str
) -> tuple[int, int]:
    """Two whole numbers written `120x40`. Raises RequestError where they are out of bounds."""
    found = re.fullmatch(r"([0-9]{1,5})x([0-9]{1,5})", text)
    size = (int(found[1]), int(found[2])) if found else (-1, -1)
    (low_x, low_y), (high_x, high_y) = lowest, largest
    if not (low_x <= size[0] <= high_x and low_y <= size[1] <= high_y):
        bounds = f"{lowest[0]}x{lowest[1]} to {largest[0]}x{largest[1]}"
        raise RequestError(f"{option} {text}: must be {meaning} from {bounds}")
    return size


def detect_display(
    options: argparse.Namespace, colour: str = "auto", ascii: bool = False
) -> Terminal:
    """Detect the terminal, with theme and symbols of the options, else of the settings.

    With `--remember` the options are stored. Raises RequestError where that fails.
    """
    from s2rtui.terminal.capabilities import detect
    from s2rtui.user_data.display_settings import DisplaySettings, read_settings, write_settings

    stored = read_settings()
    chosen = DisplaySettings(options.theme or stored.theme, options.symbols or stored.symbols)
    if options.remember:
        write_settings(chosen)
    theme = chosen.theme if chosen.theme in THEME_NAMES else "auto"
    symbols = chosen.symbols if chosen.symbols in SYMBOL_NAMES else "quadrant"
    return detect(colour, ascii, theme=str(theme), symbols=cast("Symbols", symbols))


if TYPE_CHECKING:
    from s2rtui.export.figures import PageOptions


def add_page(parser: argparse.ArgumentParser, group: str) -> argparse._ArgumentGroup:
    """Add `--width`, `--dpi` and `--cmap` in a new group, and return it."""
    page = parser.add_argument_group(group)
    add = page.add_argument
    add("--width", type=float, metavar="MM",
        help="width of figures on paper in millimetres, with fonts of 8 to 10 points")  # fmt: skip
    add("--dpi", type=int, metavar="N",
        help="pixels per inch of --width (default 300); without it, of 160 mm")  # fmt: skip
    add("--cmap", default="turbo", metavar="NAME",
        help="colour map of continuous values: turbo (default), viridis, plasma, inferno, magma "
        "or cividis")  # fmt: skip
    return page


def page_options(options: argparse.Namespace, **changes: Any) -> PageOptions:
    """The parsed options. Raises RequestError for wrong values."""
    from s2rtui.export.figures import PageOptions

    values = {"width": options.width, "dpi": options.dpi, "cmap": options.cmap}
    title = getattr(options, "title", None)
    return PageOptions(**({**values, "title": title} | changes))
