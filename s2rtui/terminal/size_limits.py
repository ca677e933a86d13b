"""How large a screen may be: beyond it memory and time of one drawing have no limit."""

from __future__ import annotations

COLUMNS, ROWS = 1000, 500
"""More than a wall of four 4K displays shows in a legible type; one drawing takes tens of MB."""


def within_bounds(columns: int, rows: int) -> tuple[int, int]:
    """The part of a terminal that is drawn on: its upper left."""
    return min(max(columns, 0), COLUMNS), min(max(rows, 0), ROWS)
