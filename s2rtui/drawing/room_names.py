"""Names of rooms in cells, placed where they cover the fewest marks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len

from s2rstore.records import Room
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import Canvas

_UNSELECTED, _SELECTED, _CURSOR = 1, 20, 1000
"""Costs of a name in a cell with unselected points, with a selected mark, with the cursor."""


def mark_costs(before: Canvas, canvas: Canvas) -> NDArray[np.intp]:
    """What a name costs in each cell (h, w); `before` is the canvas without selected marks."""
    braille = (before.char >= "\u2801") & (before.char <= "\u28ff")
    dots = braille | (before.char == canvas.glyphs.unselected)
    costs = np.where(dots, _UNSELECTED, 0)
    marked = (canvas.char != before.char) | (canvas.fg != before.fg).any(axis=-1)
    costs[marked] = _SELECTED
    costs[canvas.char == canvas.glyphs.cursor] = _CURSOR
    return costs.astype(np.intp)


def draw_room_names(
    canvas: Canvas, rooms: Sequence[Room], frame: MapFrame, costs: NDArray[np.intp]
) -> None:
    """Write each room's name once, on page colour and in front of points, where it fits.

    Of all places in the room, the one of least cost (h, w) is taken that is nearest to its middle.
    """
    costs, named = costs.copy(), set[str]()
    for room in rooms:
        if room.room in named:
            continue
        named.add(room.room)
        name = canvas.options.printable(room.room)
        corners = frame.to_cells([[room.x0, room.y0], [room.x1, room.y1]])
        place = _place(costs, corners.min(axis=0), corners.max(axis=0), cell_len(name))
        if place is not None:
            column, row = place
            canvas.text(column, row, name, canvas.theme.muted, canvas.theme.background)
            costs[row, column : column + cell_len(name)] = _CURSOR


def _place(
    costs: NDArray[np.intp], first: NDArray[np.float64], last: NDArray[np.float64], length: int
) -> tuple[int, int] | None:
    """The best column and row for `length` cells between two corners in cells, if they fit."""
    height, width = costs.shape
    left, top = (max(0, int(np.ceil(part))) for part in first)
    right, bottom = min(width, int(last[0])), min(height, int(last[1]))
    if length < 1 or right - left < length or bottom <= top:
        return None
    sums = np.cumsum(np.pad(costs[top:bottom, left:right], ((0, 0), (1, 0))), axis=1)
    covered = sums[:, length:] - sums[:, :-length]
    middle = (first + last) / 2
    rows = np.arange(top, bottom) + 0.5 - middle[1]
    columns = np.arange(left, right - length + 1) + length / 2 - middle[0]
    distance = 2 * np.abs(rows)[:, None] + np.abs(columns)
    order = np.lexsort((distance.ravel(), covered.ravel()))
    row, column = divmod(int(order[0]), covered.shape[1])
    return left + column, top + row
