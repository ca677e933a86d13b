"""Background loading for the views. A new loader is two functions and a line in `LOADERS`."""

from s2rtui.charts.registry import VIEWS
from s2rtui.charts.view import StatisticsView
from s2rtui.loaders import live_prediction, store_data
from s2rtui.loaders.loader import Fields, Key, LoadContext, Loader
from s2rtui.session.provenance import visible_floor_key

LOADERS: tuple[Loader, ...] = (
    Loader("run", store_data.run_key, store_data.read_run, is_debounced=False),
    Loader("other run", store_data.other_key, store_data.read_other, is_debounced=False),
    Loader("columns", lambda store, state: (state.generation, state.run), store_data.read_columns),
    Loader(
        "rows", lambda store, state: (state.generation, state.runs), store_data.read_rows,
        is_debounced=False,
    ),
    Loader(
        "lines", store_data.lines_key, store_data.read_lines, is_debounced=False,
    ),
    Loader(
        "floor plan", store_data.floor_plan_key, store_data.read_floor_plan, ("floor_plan",),
        is_debounced=False,
    ),
    Loader(
        "pictures", store_data.pictures_key, store_data.read_pictures,
        ("pictures", "pictures_source"),
    ),
    Loader(
        "sheet", store_data.sheet_key, store_data.read_sheet, ("sheet",), is_debounced=False,
    ),
    Loader(
        "heat on the map", store_data.grid_key, store_data.read_grid,
        ("floor_heat", "floor_heat_source"),
    ),
    Loader(
        "seen floor",
        lambda store, state: visible_floor_key(state) if state.dims_unseen_floor else None,
        store_data.read_seen, ("seen_floor", "seen_floor_source"),
    ),
    Loader(
        "history", lambda store, state: (state.history,) if state.history else None,
        store_data.read_history, ("history",),
    ),
    Loader("groups", store_data.groups_key, store_data.read_groups, ("groups",)),
    Loader("cells", store_data.cells_key, store_data.read_cells, ("cells",)),
    Loader("findings", store_data.findings_key, store_data.read_findings, ("findings",)),
    *map(store_data.model_loader, (view for view in VIEWS if isinstance(view, StatisticsView))),
    Loader(
        "live", live_prediction.live_key, live_prediction.read_live,
        ("live", "live_source", "live_floor_heat"), is_debounced=False, shows_outdated=True,
        release=live_prediction.release,
    ),
)  # fmt: skip

__all__ = ["LOADERS", "Fields", "Key", "LoadContext", "Loader"]
