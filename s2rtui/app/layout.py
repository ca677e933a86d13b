"""The rectangles of the views in cells, for a screen size."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from textual.geometry import Region

SizeClass = Literal["tiny", "narrow", "medium", "wide"]
MIN_SIZE = (40, 12)
_GUTTER = 2
_TALL, _FINDINGS = 50, 18
"""Rows from which the findings are shown below the centre, and the rows that they take."""
_SHARES = {"umap": 5, "orientation": 4, "rooms": 4, "errors": 4}
"""Shares of the rows of the left column below the overview."""
_ALL_SHARES_ROWS = 44
"""Rows below the overview that all of these views need."""
_LEAST_ROWS = 5
"""Rows of the overview below which it may have empty ones."""
_FURTHER = ("errors", "rooms", "umap", "list")
"""Views that take free rows below another one, the first that is not on the screen."""
_FURTHER_ROWS = 11
"""Free rows that a further view and the empty row above it need."""


Rows = Callable[[str, int], int]
"""Preferred rows of a view, with its title, at a width; 0 where it takes all that are free."""


def _all_rows(view: str, width: int) -> int:
    return 0


@dataclass(frozen=True, slots=True)
class LayoutRequest:
    """The active view, the views of centre and tab, and the rows that views prefer.

    The overview can do with `overview_step` rows less, any number of times. `filled` names the view
    that takes the whole screen; empty for none.
    """

    view: str
    centre: str
    tab: str
    overview_rows: int
    filled: str = ""
    overview_step: int = 1
    rows: Rows = _all_rows

    def fitting_overview(self, most: int) -> int:
        """Rows of the overview, at most `most`, that leave none of them empty if possible."""
        excess = max(0, self.overview_rows - most)
        step = max(1, self.overview_step)
        rows = self.overview_rows - -(-excess // step) * step
        return rows if rows >= _LEAST_ROWS else min(self.overview_rows, most)


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
    centre = _useful_width(request, round(width * 0.58), width // 3, height)
    x = centre + _GUTTER
    top = request.fitting_overview(height // 3)
    below = top + 1
    tab = request.tab if request.view in (request.centre, "overview") else request.view
    right = {
        "overview": Region(x, 0, width - x, top),
        tab: Region(x, below, width - x, height - below),
    }
    return right | _column(request, request.centre, Region(0, 0, centre, height), right)


def _wide(width: int, height: int, request: LayoutRequest) -> dict[str, Region]:
    """The overview over the distributions, the centre, and one column for the instance."""
    left = max(46, round(width * 0.27))
    free = width - left - 2 * _GUTTER
    right = max(46, round(width * 0.3))
    below = _FINDINGS if height >= _TALL and request.centre != "findings" else 0
    right = free - _useful_width(request, free - right, free // 2, height - below)
    column = Region(width - right, 0, right, height)
    centre = Region(left + _GUTTER, 0, free - right, height)
    top = request.fitting_overview(height * 2 // 5)
    stack = Region(0, top, left, height - top)
    if height - top >= _ALL_SHARES_ROWS:
        rectangles = _stacked(tuple(_SHARES), stack)
    else:
        rectangles = _stacked(("umap", "orientation", "rooms"), stack)
    rectangles["overview"] = Region(0, 0, left, top)
    if below:
        above = min(height - below, request.rows(request.centre, centre.width) or height)
        rectangles["findings"] = Region(centre.x, above + 1, centre.width, height - above - 1)
        rectangles[request.centre] = Region(centre.x, 0, centre.width, above)
    else:
        rectangles |= _column(request, request.centre, centre, rectangles)
    tab = "instance" if request.tab in _SHARES else request.tab
    rectangles |= _column(request, tab, column, rectangles)
    last = request.view if request.view in ("rooms", "errors") else request.tab
    if last == "errors" and last not in rectangles:
        rectangles["errors"] = rectangles.pop("rooms")
    return rectangles


def _stacked(names: tuple[str, ...], area: Region) -> dict[str, Region]:
    """Views above one another, each below an empty row, with rows in proportion to `_SHARES`."""
    rectangles, y, total = {}, area.y, sum(_SHARES[name] for name in names)
    for name in names:
        is_last = name == names[-1]
        rows = area.bottom - y if is_last else round(area.height * _SHARES[name] / total)
        rectangles[name] = Region(0, y + 1, area.width, rows - 1)
        y += rows
    return rectangles


def _useful_width(request: LayoutRequest, most: int, least: int, height: int) -> int:
    """The columns of the centre, up to `most`, that its view can use in `height` rows."""
    width = most
    while width > least and request.rows(request.centre, width) > height:
        width -= 1
    return width


def _column(
    request: LayoutRequest, view: str, area: Region, others: Iterable[str]
) -> dict[str, Region]:
    """A view in an area, and a further view below it if the first one leaves enough rows."""
    rows = request.rows(view, area.width)
    shown = {view, request.centre, *others}
    further = next((name for name in _FURTHER if name not in shown), None)
    if not rows or further is None or area.height - rows < _FURTHER_ROWS:
        return {view: area}
    below = Region(area.x, area.y + rows + 1, area.width, area.height - rows - 1)
    return {view: Region(area.x, area.y, area.width, rows), further: below}
