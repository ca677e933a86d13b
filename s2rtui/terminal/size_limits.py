"""The largest screen that is drawn, which bounds memory and time of one drawing."""

from __future__ import annotations

COLUMNS, ROWS = 1000, 500
"""More than four 4K displays show legibly; one drawing takes tens of MB."""


def within_bounds(columns: int, rows: int) -> tuple[int, int]:
    """Limit a terminal size; the upper left part is drawn."""
    return min(max(columns, 0), COLUMNS), min(max(rows, 0), ROWS)
