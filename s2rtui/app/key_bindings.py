"""The action registry: key bindings, footer, help and command palette are made from it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from s2rstore.metrics import nearest_neighbours
from s2rtui.app.action import Action, When, key_name
from s2rtui.charts.registry import VIEWS
from s2rtui.charts.shared.instance_input import NEIGHBOURS
from s2rtui.security import Permissions
from s2rtui.session import (
    adjusting,
    brush_geometry,
    error_groups,
    images,
    instance_list,
    navigation,
    selection,
    view_settings,
)
from s2rtui.session.context import Reducer, SessionContext
from s2rtui.session.session import Session
from s2rtui.session.state import Brush, State

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp

_OF_ONE_VIEW: tuple[When, ...] = (
    "list", "adjust", "groups", "rows", "rows of instances", "instance", "sheet", "pivot",
    "suggestions", "drives",
)  # fmt: skip
"""Situations in which one view is active."""
_PAGE, _ALL_ROWS = 10, 1 << 30
"""Rows of a table that the page keys scroll, and more than any table has."""
_SCRUB = 5
"""Steps by which a key moves in time."""


def _do(reducer: Reducer, *arguments: Any) -> Callable[[Session], object]:
    return lambda session: session.dispatch(reducer, *arguments)


def _select(expression: str) -> Callable[[Session], object]:
    return _do(selection.select, expression)


def _brush(function: Callable[..., Brush], *steps: int) -> Callable[[S2RApp], object]:
    return lambda app: app.brush.transform(function, *steps)


def _select_similar(context: SessionContext, state: State) -> State:
    """Select the present instance and its nearest neighbours in the run's embedding."""
    if state.cursor is None:
        return state.with_message("no instance to compare with: select some")
    if not nearest_neighbours.can_compare(context.store, state.run):
        command = context.store.run(state.run).embedding_command
        return state.with_message(
            f"run {state.run} has no embeddings to compare; {command} makes them"
        )
    function = "sim.like" if state.side == "sim" else "like"
    expression = f"{function}({state.cursor}, {NEIGHBOURS})"
    return selection.select(context, state, expression)


_OPERATORS = (
    Action("intersect", "ampersand", "select", "intersect with the next selection",
           _do(selection.set_operator, "intersect"), "and", "&", "still"),
    Action("union", "vertical_line", "select", "add the next selection",
           _do(selection.set_operator, "union"), "", "|", "still"),
    Action("subtract", "minus", "select", "subtract the next selection",
           _do(selection.set_operator, "subtract"), "", "-", "still"),
    Action("complement", "exclamation_mark", "select", "complement: all other instances",
           _do(selection.complement), "", "!", "still"),
)  # fmt: skip


def _brushing(
    name: str, key: str, description: str, command: Callable[[S2RApp], object], short: str = "",
    shown: str = "",
) -> Action:  # fmt: skip
    """An action that is available while a brush is drawn."""
    return Action(name, key, "brush", description, None, short, shown, "brushing", "", command)


_BRUSHING = (
    Action("brush", "x", "brush", "start a brush in this view, by keys", short="brush",
           command=lambda app: app.brush.start(), when="still"),
    _brushing("brush_select", "enter", "select the instances inside",
              lambda app: app.brush.apply(None), "apply"),
    _brushing("brush_intersect", "ampersand", "intersect the selection with them",
              lambda app: app.brush.apply("intersect"), "and", "&"),
    _brushing("brush_union", "vertical_line", "add them to the selection",
              lambda app: app.brush.apply("union"), "or", "|"),
    _brushing("brush_subtract", "minus", "subtract them from the selection",
              lambda app: app.brush.apply("subtract"), "less", "-"),
    _brushing("brush_left", "left", "move the brush", _brush(brush_geometry.moved, -1, 0), "move",
              "arrows"),
    Action("leave", "escape", "brush", "cancel brush, operator or input line; stop playing",
           short="cancel", when="begun"),
    _brushing("brush_right", "right", "", _brush(brush_geometry.moved, 1, 0)),
    _brushing("brush_up", "up", "", _brush(brush_geometry.moved, 0, -1)),
    _brushing("brush_down", "down", "", _brush(brush_geometry.moved, 0, 1)),
    _brushing("brush_stretch_left", "shift+left", "move its far corner",
              _brush(brush_geometry.stretched, -1, 0), shown="shift+arrows"),
    _brushing("brush_stretch_right", "shift+right", "", _brush(brush_geometry.stretched, 1, 0)),
    _brushing("brush_stretch_up", "shift+up", "", _brush(brush_geometry.stretched, 0, -1)),
    _brushing("brush_stretch_down", "shift+down", "", _brush(brush_geometry.stretched, 0, 1)),
    _brushing("brush_shrink", "z", "shrink the brush", _brush(brush_geometry.scaled, -1),
              "smaller"),
    _brushing("brush_grow", "Z", "enlarge the brush", _brush(brush_geometry.scaled, 1), "larger"),
    _brushing("brush_corner", "space", "set a corner of the lasso",
              lambda app: app.brush.set_corner()),
    _brushing("brush_panel", "tab", "brush the next panel of the view",
              lambda app: app.brush.next_panel(), "panel"),
    Action("lasso", "L", "brush", "brush with a lasso or with a box; converts a drawn brush",
           command=lambda app: app.brush.toggle_lasso()),
)  # fmt: skip

_ADJUSTING = (
    Action("adjust", "a", "adjust", "adjust images live", short="adjust", when="plain",
           needs="models", command=lambda app: app.adjust.open_sliders()),
    Action("slider_up", "up", "adjust", "choose another slider",
           _do(adjusting.choose_slider, -1), shown="up, down", when="adjust"),
    Action("slider_down", "down", "adjust", "", _do(adjusting.choose_slider, 1), when="adjust"),
    Action("less", "left", "adjust", "move the slider; with shift by five steps",
           _do(adjusting.move_slider, -1), "slider", "<- ->", "adjust"),
    Action("more", "right", "adjust", "", _do(adjusting.move_slider, 1), when="adjust"),
    Action("much_less", "shift+left", "adjust", "", _do(adjusting.move_slider, -5), when="adjust"),
    Action("much_more", "shift+right", "adjust", "", _do(adjusting.move_slider, 5), when="adjust"),
    Action("neutral", "backspace", "adjust", "reset all sliders to neutral",
           _do(adjusting.reset_sliders), "neutral", when="adjust"),
    Action("save_run", "S", "adjust",
           "save the adjustments as a run and compute it for all images", short="save run",
           when="adjust", needs="models", command=lambda app: app.adjust.ask_name()),
    Action("apply_answer", "enter", "adjust", "suggestions: apply the answer of the row", None,
           "apply", when="suggestions", command=lambda app: app.adjust.apply_answer()),
    Action("search", "S", "adjust",
           "suggestions: search the missing answers (5 minutes each); again: cancel",
           short="search", when="suggestions", needs="models",
           command=lambda app: app.suggestions.search()),
    Action("collect", "backslash", "adjust",
           "suggestions: choose poses of new images and show them on the map", None, "new images",
           "\\", "suggestions", "models", lambda app: app.suggestions.collect()),
)  # fmt: skip


def _choose(rows: int) -> Callable[[S2RApp], object]:
    return lambda app: app.navigation.move_choice(rows)


_ROWS = (
    Action("next_row_of_table", "down", "move",
           "next row of a table, such as that of rooms, recall or findings", None, "rows",
           "up, down", "rows", command=_choose(1)),
    Action("previous_row_of_table", "up", "move", "", when="rows", command=_choose(-1)),
    Action("next_page_of_table", "pagedown", "move", "next page of a table", when="rows",
           command=_choose(_PAGE)),
    Action("previous_page_of_table", "pageup", "move", "", when="rows", command=_choose(-_PAGE)),
    Action("table_start", "home", "move", "first row of a table", when="rows",
           command=_choose(-_ALL_ROWS)),
    Action("table_end", "end", "move", "last row of a table", when="rows",
           command=_choose(_ALL_ROWS)),
    Action("open_row", "enter", "select", "select the instances of the row of a table", None,
           "select", when="rows of instances", command=lambda app: app.navigation.open_row()),
)  # fmt: skip

_IMAGES = (
    Action("thumbnail_right", "right", "move", "next thumbnail of the sheet",
           _do(instance_list.move, 1), "image", "arrows", "sheet"),
    Action("thumbnail_left", "left", "move", "", _do(instance_list.move, -1), when="sheet"),
    Action("thumbnail_down", "down", "move", "", when="sheet",
           command=lambda app: app.navigation.move_row(1)),
    Action("thumbnail_up", "up", "move", "", when="sheet",
           command=lambda app: app.navigation.move_row(-1)),
    Action("next_sheet", "pagedown", "move", "next page of the sheet", _do(images.turn_page, 1),
           "page", "page down", when="sheet"),
    Action("previous_sheet", "pageup", "move", "previous page of the sheet",
           _do(images.turn_page, -1), when="sheet"),
    Action("first_thumbnail", "home", "move", "", _do(instance_list.to_end, False), when="sheet"),
    Action("last_thumbnail", "end", "move", "", _do(instance_list.to_end, True), when="sheet"),
    Action("open_instance", "enter", "views", "open the instance of the sheet on the whole screen",
           None, "open", when="sheet", command=lambda app: app.navigation.open_instance()),
    Action("picture", "backslash", "views", "sheet: real, sim, difference or heat",
           _do(images.change_picture), "images", "\\", "sheet"),
    Action("fewer", "less_than_sign", "views", "sheet: fewer, larger thumbnails",
           _do(images.change_count, -1), "size", "<", "sheet"),
    Action("more_thumbnails", "greater_than_sign", "views", "sheet: more, smaller thumbnails",
           _do(images.change_count, 1), "", ">", "sheet"),
    Action("cell_right", "right", "move", "pivot: cell beside the chosen one", None, "cell",
           "<- ->", "pivot", command=lambda app: app.navigation.move_choice(0, 1)),
    Action("cell_left", "left", "move", "", when="pivot",
           command=lambda app: app.navigation.move_choice(0, -1)),
    Action("later", "right", "move", "drives: move in time", None, "time", "<- ->", "drives",
           command=lambda app: app.player.move(_SCRUB)),
    Action("earlier", "left", "move", "", when="drives",
           command=lambda app: app.player.move(-_SCRUB)),
    Action("figure", "backslash", "review", "pivot: median, number, recall or share of errors",
           _do(error_groups.change_figure), "figure", "\\", "pivot"),
    Action("arrangement", "backslash", "views",
           "instance: both sides beside each other, blinking, or with a divider that slides",
           None, "sides", "\\", "instance", command=lambda app: app.player.change_arrangement()),
    Action("divider_left", "less_than_sign", "views", "instance: move the divider",
           _do(images.move_divider, -1), shown="<", when="instance"),
    Action("divider_right", "greater_than_sign", "views", "", _do(images.move_divider, 1),
           shown=">", when="instance"),
)  # fmt: skip

ACTIONS: tuple[Action, ...] = (
    Action("worst_real", "w", "select", "worst 15 % in reality (min)", _select("worst15"),
           "worst", when="still"),
    Action("best_real", "b", "select", "best 15 % in reality (max)", _select("best15"),
           "best", when="still"),
    Action("worst_sim", "W", "select", "worst 15 % in simulation",
           _select("worst(15%, sim.error)"), when="still"),
    Action("best_sim", "B", "select", "best 15 % in simulation",
           _select("best(15%, sim.error)"), when="still"),
    Action("straight", "i", "select", "straight driving (turn below 10 degrees)",
           _select("straight"), when="still"),
    Action("curved", "j", "select", "curves (turn of 10 degrees or more)",
           _select("curved"), when="still"),
    Action("alike", "l", "select", "instances whose embeddings are most similar to this one",
           _do(_select_similar), when="still"),
    Action("all", "c", "select", "select all", _do(selection.select, "all", "replace"),
           "all", when="still"),
    *_OPERATORS,
    *_BRUSHING,
    *_ADJUSTING,
    *_IMAGES,
    Action("edit", "slash", "select", "type a selection expression", None, "query", "/", "still",
           command=lambda app: app.prompt.edit_expression()),
    Action("undo", "u", "select", "undo: the previous selection or run", _do(navigation.undo)),
    Action("redo", "U", "select", "redo: the next selection or run", _do(navigation.redo)),
    Action("select_suggested", "Y", "select",
           "after an empty selection: the wider expression that the message suggests",
           _do(selection.select_suggested), when="still"),
    Action("copy", "y", "select", "copy the expression to the clipboard",
           command=lambda app: app.export.copy_expression()),
    Action("save_selection", "at", "select", "save the selection under a name", shown="@",
           command=lambda app: app.annotations.save_selection()),
    Action("write_selection", "F", "select", "export the selection: CSV, JSON, Parquet",
           command=lambda app: app.export.ask_selection_file()),
    Action("selections", "f", "select", "saved selections and history",
           command=lambda app: app.annotations.choose_selection()),
    Action("next_instance", "n", "move", "next instance",
           _do(navigation.move_cursor, 1), when="still"),
    Action("previous_instance", "p", "move", "previous instance",
           _do(navigation.move_cursor, -1), when="still"),
    Action("instance_right", "right", "move", "next instance",
           _do(navigation.move_cursor, 1), "instance", "->", "not sheet"),
    Action("instance_left", "left", "move", "previous instance",
           _do(navigation.move_cursor, -1), "", "<-", "not sheet"),
    Action("play", "apostrophe", "move", "play through the instances or the drive; faster; stop",
           shown="'", command=lambda app: app.player.change_speed()),
    Action("next_row", "down", "move", "next row of the list",
           _do(instance_list.move, 1), "rows", "up, down", "list"),
    *_ROWS,
    Action("previous_row", "up", "move", "previous row of the list",
           _do(instance_list.move, -1), when="list"),
    Action("page_down", "pagedown", "move", "next page of the list",
           _do(instance_list.move, 20), when="list"),
    Action("page_up", "pageup", "move", "previous page of the list",
           _do(instance_list.move, -20), when="list"),
    Action("first_row", "home", "move", "first row of the list, or first instance",
           _do(instance_list.to_end, False), when="list"),
    Action("last_row", "end", "move", "last row of the list, or last instance",
           _do(instance_list.to_end, True), when="list"),
    Action("first_instance", "home", "move", "", _do(navigation.move_to_end, False),
           when="elsewhere"),
    Action("last_instance", "end", "move", "", _do(navigation.move_to_end, True),
           when="elsewhere"),
    Action("next_run", "r", "move", "next run", _do(navigation.change_run, 1), "run", when="still"),
    Action("previous_run", "R", "move", "previous run",
           _do(navigation.change_run, -1), when="still"),
    Action("run_below", "down", "move", "next run", _do(navigation.change_run, 1),
           when="elsewhere"),
    Action("run_above", "up", "move", "previous run", _do(navigation.change_run, -1),
           when="elsewhere"),
    Action("trajectory", "t", "move", "next trajectory, or all",
           _do(navigation.change_trajectory), when="still"),
    Action("trained", "M", "select",
           "include trained instances, or leave them out",
           _do(navigation.toggle_trained), when="still"),
    Action("next_heat", "h", "heat", "next heatmap kind",
           _do(view_settings.change_heat, 1), "heat"),
    Action("previous_heat", "H", "heat", "previous heatmap kind",
           _do(view_settings.change_heat, -1)),
    Action("mode", "v", "heat", "next mode of this heatmap kind", _do(view_settings.change_mode)),
    Action("overlay", "o", "heat", "heat on the map: off, instance, selection, run",
           _do(view_settings.change_overlay), "on map"),
    Action("aggregate", "A", "heat", "heat on the map: mean, max, sum, count",
           _do(view_settings.change_aggregate)),
    Action("side", "d", "heat", "side whose heatmaps are shown: real or sim",
           _do(view_settings.change_side)),
    Action("map_mode", "m", "map", "map mode: colour, glyph or full",
           _do(view_settings.change_map_mode), "map"),
    Action("map_value", "P", "map", "colour of the map: shift, errors, gap, shares of the gap",
           _do(view_settings.change_map_value)),
    Action("zoom_in", "z,plus,equals_sign", "views",
           "zoom in (map, images of the instance, UMAP, scatter, comparison)", when="still",
           command=lambda app: app.navigation.zoom(1 / 0.6)),
    Action("zoom_out", "Z", "views", "zoom out", when="still",
           command=lambda app: app.navigation.zoom(0.6)),
    Action("zoom_all", "0", "views", "reset the zoom",
           command=lambda app: app.navigation.zoom(0)),
    Action("pan_left", "shift+left", "views", "move what the zoomed view shows",
           shown="shift+arrows", when="plain", command=lambda app: app.navigation.pan(-0.2, 0)),
    Action("pan_right", "shift+right", "views", "", when="plain",
           command=lambda app: app.navigation.pan(0.2, 0)),
    Action("pan_up", "shift+up", "views", "", when="still",
           command=lambda app: app.navigation.pan(0, -0.2)),
    Action("pan_down", "shift+down", "views", "", when="still",
           command=lambda app: app.navigation.pan(0, 0.2)),
    Action("fill_screen", "V", "views", "fill the screen with this view, and back",
           command=lambda app: app.navigation.fill_screen()),
    Action("clip", "C", "map", "dim the floor that no selected instance has seen",
           _do(view_settings.toggle_clip)),
    Action("room_names", "N", "map", "show or hide room names",
           _do(view_settings.toggle_room_names)),
    Action("sort", "full_stop", "review", "sort the list by the next column",
           _do(instance_list.sort_by_next_column), shown=".", when="not groups"),
    Action("reverse", "comma", "review", "reverse the order of the list",
           _do(instance_list.reverse), shown=",", when="not groups"),
    Action("sort_groups", "full_stop", "review", "in the rooms view: sort by the next column",
           _do(error_groups.sort_by_next_column), shown=".", when="groups"),
    Action("reverse_groups", "comma", "review", "in the rooms view: reverse the order",
           _do(error_groups.reverse), shown=",", when="groups"),
    Action("group", "O", "review",
           "rooms view: errors by room, heading, curvature, trajectory; counts",
           _do(error_groups.change_grouping)),
    Action("cross_groups", "asterisk", "review", "rooms view, pivot: another second grouping",
           _do(error_groups.cross_grouping), shown="*"),
    Action("other_run", "k", "review", "compare with the next run",
           _do(view_settings.change_other)),
    Action("note", "e", "review", "write a note on this instance",
           command=lambda app: app.annotations.edit_note()),
    Action("tag", "number_sign", "review", "tag this instance", shown="#",
           command=lambda app: app.annotations.edit_tag()),
    *(
        Action(f"view('{view.name}')", key_name(view.key), "views", view.description,
               shown=view.key)
        for view in VIEWS
        if view.from_store
    ),
    Action("findings", "f1", "views", "", shown="F1",
           command=lambda app: app.navigation.show_view("findings")),
    Action("next_view", "tab", "views", "next view", short="view", when="still",
           command=lambda app: app.navigation.show_next_view(1)),
    Action("previous_view", "shift+tab", "views", "previous view", when="still",
           command=lambda app: app.navigation.show_next_view(-1)),
    Action("jump", "space", "views", "jump to a view by a letter", when="still",
           command=lambda app: app.navigation.jump()),
    Action("newest_generation", "g", "program", "open the newest generation of the store",
           Session.open_newest_generation),
    Action("snapshot", "s", "program", "write the screen as PNG", short="snapshot",
           command=lambda app: app.export.write_screenshot()),
    Action("report", "E", "program", "write a report of the saved selections (HTML)",
           command=lambda app: app.export.write_report()),
    Action("doctor", "D", "program", "check what this terminal supports"),
    Action("tour", "T", "program", "show the introduction again"),
    Action("help", "question_mark", "program", "list all keys", short="help", shown="?"),
    Action("quit", "q", "program", "quit", short="quit"),
)  # fmt: skip
BY_NAME = {action.name: action for action in ACTIONS}


def find_action(call: str, parameters: tuple[object, ...] = ()) -> Action | None:
    """The action of a Textual action name and parameters; None if it is not registered."""
    if call == "do":
        return BY_NAME.get(str(parameters[0]))
    listed = ", ".join(repr(parameter) for parameter in parameters)
    return BY_NAME.get(f"{call}({listed})" if parameters else call)


def permitted_actions(access: Permissions | None = None) -> list[Action]:
    """The actions that the session's permissions allow."""
    return [action for action in ACTIONS if access is None or access.allows(action.needs)]


def footer(width: int, state: State, access: Permissions | None = None) -> list[tuple[str, str]]:
    """(key, label) pairs that fit into `width` columns; help and quit have priority.

    The keys of the active view come before the keys of all views.
    """
    applicable = [a for a in permitted_actions(access) if a.short and a.applies(state)]
    applicable.sort(key=lambda action: action.when not in _OF_ONE_VIEW)
    words = [(action.key, action.short) for action in applicable]
    last = [pair for pair in words if pair[1] in ("help", "quit")]
    room = width - sum(len(key) + len(word) + 3 for key, word in last)
    shown = []
    for key, word in words:
        if (key, word) not in last and len(key) + len(word) + 3 <= room:
            room -= len(key) + len(word) + 3
            shown.append((key, word))
    return [*shown, *last]
