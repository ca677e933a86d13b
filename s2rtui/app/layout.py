"""Where each view stands on a screen of a given size: plain numbers, drawn by the panes' layout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

SizeClass = Literal["tiny", "narrow", "medium", "wide"]
SMALLEST = (40, 12)
_GUTTER = 2
_SHARES = {"umap": 5, "orientation": 4, "rooms": 4, "errors": 4}
"""Rows of the left column beside the overview, in proportion."""


@dataclass(frozen=True, slots=True)
class PaneRectangle:
    """Cells: a corner and a size."""

    x: int
    y: int
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class LayoutRequest:
    """What the state asks for: the active view, the centre's and the tab's, the overview's rows."""

    view: str
    centre: str
    tab: str
    overview_rows: int


def size_class(width: int, height: int) -> SizeClass:
    """The class of the whole screen."""
    if width < SMALLEST[0] or height < SMALLEST[1]:
        return "tiny"
    if width >= 150 and height >= 36:
        return "wide"
    return "medium" if width >= 100 and height >= 30 else "narrow"


def arrange(
    size: SizeClass, width: int, height: int, wanted: LayoutRequest
) -> dict[str, PaneRectangle]:
    """Places by view name in an area of `width` x `height` cells; who has none is hidden."""
    if size == "tiny" or width < 1 or height < 1:
        return {}
    if size == "narrow":
        return {wanted.view: PaneRectangle(0, 0, width, height)}
    return (_wide if size == "wide" else _medium)(width, height, wanted)


def _medium(width: int, height: int, wanted: LayoutRequest) -> dict[str, PaneRectangle]:
    """The centre, and beside it the overview over one of the others: the active one, if any."""
    centre = round(width * 0.58)
    x = centre + _GUTTER
    top = min(wanted.overview_rows, height // 3)
    below = top + 1
    tab = wanted.tab if wanted.view in (wanted.centre, "overview") else wanted.view
    return {
        wanted.centre: PaneRectangle(0, 0, centre, height),
        "overview": PaneRectangle(x, 0, width - x, top),
        tab: PaneRectangle(x, below, width - x, height - below),
    }


def _wide(width: int, height: int, wanted: LayoutRequest) -> dict[str, PaneRectangle]:
    """The overview over the distributions, the centre, and one column for the instance."""
    left = max(46, round(width * 0.27))
    right = max(46, round(width * 0.3))
    top = min(wanted.overview_rows, height * 2 // 5)
    places = {
        "overview": PaneRectangle(0, 0, left, top),
        wanted.centre: PaneRectangle(left + _GUTTER, 0, width - left - right - 2 * _GUTTER, height),
        _column(wanted): PaneRectangle(width - right, 0, right, height),
    }
    y, rows = top, height - top
    names = _stacked(wanted, rows)
    total = sum(_SHARES[name] for name in names)
    for index, name in enumerate(names):
        share = height - y if index == len(names) - 1 else round(rows * _SHARES[name] / total)
        places[name] = PaneRectangle(0, y + 1, left, share - 1)
        y += share
    return places


def _column(wanted: LayoutRequest) -> str:
    """What stands in the right column: the chosen view where it is not in the left one."""
    return "instance" if wanted.tab in _SHARES else wanted.tab


def _stacked(wanted: LayoutRequest, rows: int) -> tuple[str, ...]:
    if rows >= 44:
        return tuple(_SHARES)
    last = wanted.view if wanted.view in ("rooms", "errors") else wanted.tab
    return ("umap", "orientation", "errors" if last == "errors" else "rooms")
