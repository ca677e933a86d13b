"""What workers bring. A new feed is two functions and a line here; of several requests the newest
wins.
"""

from s2rtui.loaders import gap_history, live_prediction, store_data
from s2rtui.loaders.loader import Caller, Feed, Fields, Key

FEEDS: tuple[Feed, ...] = (
    Feed("run", store_data.wants_run, store_data.read_run, rests=False),
    Feed("other run", store_data.wants_other, store_data.read_other, rests=False),
    Feed("columns", store_data.wants_columns, store_data.read_columns),
    Feed("rows", store_data.wants_rows, store_data.read_rows, rests=False),
    Feed("lines", store_data.wants_lines, store_data.read_lines, rests=False),
    Feed(
        "floor plan", store_data.wants_floor_plan, store_data.read_floor_plan, ("floor_plan",),
        rests=False,
    ),
    Feed("pictures", store_data.wants_pictures, store_data.read_pictures, ("pictures", "pictures_of")),
    Feed("heat on the map", store_data.wants_grid, store_data.read_grid, ("grid", "grid_of")),
    Feed("what was seen", store_data.wants_seen, store_data.read_seen, ("seen", "seen_of")),
    Feed("history", gap_history.wants_history, gap_history.read_history, ("history",)),
    Feed(
        "live", live_prediction.wants_live, live_prediction.read_live, ("live", "live_of", "live_grid"), rests=False,
        follows=True, leave=live_prediction.leave,
    ),
)  # fmt: skip

__all__ = ["FEEDS", "Caller", "Feed", "Fields", "Key"]
