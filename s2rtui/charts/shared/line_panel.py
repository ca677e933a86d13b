"""The panel of a view that lists entries line by line, of which some lie outside its rows."""

from __future__ import annotations

import math
from collections.abc import Sequence

from s2rtui.canvas import Panel, Size


def line_panels(
    name: str, entries: Sequence[int | None], first: int, size: Size
) -> tuple[Panel, ...]:
    """A panel whose y coordinate is the number of the entry on a line; -1 on lines without one.

    `entries` has the entry of every line, `first` is the line in the first row of `size` (columns,
    rows). An entry of several lines lies at its first one. There is no panel without lines.
    """
    shown = min(len(entries) - first, max(1, size[1]))
    if shown < 1:
        return ()

    def to_data(column: float, row: float) -> tuple[float, float]:
        entry = entries[min(max(first + math.floor(row), 0), len(entries) - 1)]
        return 0.0, -1.0 if entry is None else float(entry)

    def to_cells(x: float, y: float) -> tuple[float, float]:
        entry = round(y)
        line = entries.index(entry) if entry in entries else 0
        return 0.5, line - first + 0.5

    return (Panel(name, "steps", 0, 0, max(1, size[0]), shown, to_data, to_cells),)
