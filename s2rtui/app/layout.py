"""The rectangles of the views in cells, for a screen size."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from textual.geometry import Region

SizeClass = Literal["tiny", "narrow", "medium", "wide"]
MIN_SIZE = (40, 12)
_GUTTER = 2
_SHARES = {"umap": 5, "orientation": 4, "rooms": 4, "errors": 4}
"""Shares of the rows of the left column below the overview."""


@dataclass(frozen=True, slots=True)
class LayoutRequest:
    """The active view, the views of centre and tab, and the rows that the overview needs.

    `filled` names the view that takes the whole screen; empty for none.
    """

    view: str
    centre: str
    tab: str
    overview_rows: int
    filled: str = ""


def size_class(width: int, height: int) -> SizeClass:
    """The size class of a screen."""
    if width < MIN_SIZE[0] or height < MIN_SIZE[1]:
        return "tiny"
    if width >= 150 and height >= 36:
        return "wide"
    return "medium" if width >= 100 and height >= 30 else "narrow"


def arrange(size: SizeClass, width: int, height: int, request: LayoutRequest) -> dict[str, Region]:
    """Rectangles by view name in `width` x `height` cells; views without one are hidden."""
    if size == "tiny" or width < 1 or height < 1:
        return {}
    if size == "narrow" or request.filled:
        return {request.filled or request.view: Region(0, 0, width, height)}
    return (_wide if size == "wide" else _medium)(width, height, request)


def _medium(width: int, height: int, request: LayoutRequest) -> dict[str, Region]:
    """The centre, and beside it the overview above one other view, the active one if possible."""
    centre = round(width * 0.58)
    x = centre + _GUTTER
    top = min(request.overview_rows, height // 3)
    below = top + 1
    tab = request.tab if request.view in (request.centre, "overview") else request.view
    return {
        request.centre: Region(0, 0, centre, height),
        "overview": Region(x, 0, width - x, top),
        tab: Region(x, below, width - x, height - below),
    }


def _wide(width: int, height: int, request: LayoutRequest) -> dict[str, Region]:
    """The overview over the distributions, the centre, and one column for the instance."""
    left = max(46, round(width * 0.27))
    right = max(46, round(width * 0.3))
    top = min(request.overview_rows, height * 2 // 5)
    column = "instance" if request.tab in _SHARES else request.tab
    rectangles = {
        "overview": Region(0, 0, left, top),
        request.centre: Region(left + _GUTTER, 0, width - left - right - 2 * _GUTTER, height),
        column: Region(width - right, 0, right, height),
    }
    y, rows = top, height - top
    names = _stacked(request, rows)
    total = sum(_SHARES[name] for name in names)
    for index, name in enumerate(names):
        share = height - y if index == len(names) - 1 else round(rows * _SHARES[name] / total)
        rectangles[name] = Region(0, y + 1, left, share - 1)
        y += share
    return rectangles


def _stacked(request: LayoutRequest, rows: int) -> tuple[str, ...]:
    if rows >= 44:
        return tuple(_SHARES)
    last = request.view if request.view in ("rooms", "errors") else request.tab
    return ("umap", "orientation", "errors" if last == "errors" else "rooms")
