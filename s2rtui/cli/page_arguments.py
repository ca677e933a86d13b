"""Options that describe the page of a figure, shared by `export` and `report`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

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
    from s2rtui.drawing.page import check_colour_map
    from s2rtui.export.figures import PageOptions

    check_colour_map(options.cmap)
    values = {"width": options.width, "dpi": options.dpi, "cmap": options.cmap}
    title = getattr(options, "title", "")
    return PageOptions(**({**values, "title": title} | changes))
