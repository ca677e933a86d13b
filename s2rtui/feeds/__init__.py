"""What workers bring. A new feed is two functions and a line here; of several requests the newest
wins.
"""

from s2rtui.feeds import live, nights, reading
from s2rtui.feeds.contract import Caller, Feed, Fields, Key

FEEDS: tuple[Feed, ...] = (
    Feed("run", reading.wants_run, reading.read_run, rests=False),
    Feed("other run", reading.wants_other, reading.read_other, rests=False),
    Feed("columns", reading.wants_columns, reading.read_columns),
    Feed("rows", reading.wants_rows, reading.read_rows, rests=False),
    Feed("lines", reading.wants_lines, reading.read_lines, rests=False),
    Feed(
        "floor plan", reading.wants_floor_plan, reading.read_floor_plan, ("floor_plan",),
        rests=False,
    ),
    Feed("pictures", reading.wants_pictures, reading.read_pictures, ("pictures", "pictures_of")),
    Feed("heat on the map", reading.wants_grid, reading.read_grid, ("grid", "grid_of")),
    Feed("what was seen", reading.wants_seen, reading.read_seen, ("seen", "seen_of")),
    Feed("history", nights.wants_history, nights.read_history, ("history",)),
    Feed(
        "live", live.wants_live, live.read_live, ("live", "live_of", "live_grid"), rests=False,
        follows=True, leave=live.leave,
    ),
)  # fmt: skip

__all__ = ["FEEDS", "Caller", "Feed", "Fields", "Key"]
