"""What workers bring. A new feed is two functions and a line here; of several requests the newest
wins.
"""

from s2rtui.loaders import gap_history, live_prediction, store_data
from s2rtui.loaders.loader import Fields, Key, LoadContext, Loader

LOADERS: tuple[Loader, ...] = (
    Loader("run", store_data.wants_run, store_data.read_run, rests=False),
    Loader("other run", store_data.wants_other, store_data.read_other, rests=False),
    Loader("columns", store_data.wants_columns, store_data.read_columns),
    Loader("rows", store_data.wants_rows, store_data.read_rows, rests=False),
    Loader("lines", store_data.wants_lines, store_data.read_lines, rests=False),
    Loader(
        "floor plan", store_data.wants_floor_plan, store_data.read_floor_plan, ("floor_plan",),
        rests=False,
    ),
    Loader("pictures", store_data.wants_pictures, store_data.read_pictures, ("pictures", "pictures_source")),
    Loader("heat on the map", store_data.wants_grid, store_data.read_grid, ("floor_heat", "floor_heat_source")),
    Loader("what was seen", store_data.wants_seen, store_data.read_seen, ("seen_floor", "seen_floor_source")),
    Loader("history", gap_history.wants_history, gap_history.read_history, ("history",)),
    Loader(
        "live", live_prediction.wants_live, live_prediction.read_live, ("live", "live_source", "live_floor_heat"), rests=False,
        follows=True, leave=live_prediction.leave,
    ),
)  # fmt: skip

__all__ = ["LOADERS", "Fields", "Key", "LoadContext", "Loader"]
