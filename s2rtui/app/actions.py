"""Every action once: key map, footer, help and palette are made from this table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

from s2rstore.metrics import similarity
from s2rtui.app.key_names import key_shown
from s2rtui.charts.instance.model import NEIGHBOURS
from s2rtui.charts.registry import VIEWS
from s2rtui.security import Capability, Permissions
from s2rtui.session import Session, adjusting, display, instance_list
from s2rtui.session.state import State

Group = Literal["select", "brush", "move", "heat", "map", "adjust", "review", "views", "program"]
When = Literal["always", "begun", "still", "plain", "brushing", "list", "adjust", "elsewhere"]

GROUPS: dict[Group, str] = {
    "select": "Select",
    "brush": "Brush",
    "move": "Move",
    "heat": "Heat",
    "map": "Map",
    "adjust": "Adjust",
    "review": "Review",
    "views": "Views",
    "program": "Program",
}


@dataclass(frozen=True, slots=True)
class Action:
    """`name` is unique. `do` changes the session; without it the application has `action_NAME`.

    `keys` are Textual's names, the first one shown (as `shown`); `short` is the footer's word, if
    any; `when` says in which situation the keys mean this; `needs` what a session must be allowed
    to do for the action to be offered.
    """

    name: str
    keys: tuple[str, ...]
    group: Group
    description: str
    do: Callable[[Session], object] | None = None
    short: str = ""
    shown: str = ""
    when: When = "always"
    needs: Capability = ""

    @property
    def key(self) -> str:
        return self.shown or key_shown(self.keys[0])

    @property
    def all_keys(self) -> str:
        """`z  +  =`; what is shown for a group of keys stands alone."""
        if " " in self.shown:
            return self.shown
        return "  ".join([self.key, *(key_shown(name) for name in self.keys[1:])])

    @property
    def call(self) -> str:
        """The action as Textual calls it."""
        return self.name if self.do is None else f"do('{self.name}')"

    def applies(self, state: State) -> bool:
        """Whether it means something in a state."""
        brushing = state.brush is not None
        return {
            "always": True,
            "begun": brushing or state.operator != "replace" or state.is_error,
            "still": not brushing,
            "plain": not brushing and state.view != "adjust",
            "adjust": not brushing and state.view == "adjust",
            "brushing": brushing,
            "list": not brushing and state.view == "list",
            "elsewhere": not brushing and state.view not in ("list", "adjust"),
        }[self.when]


def _choose(expression: str) -> Callable[[Session], object]:
    return lambda session: session.choose(expression)


def _choose_alike(session: Session) -> object:
    """The present instance and those that the run sees alike, on the side that is shown."""
    state = session.state
    if state.cursor is None:
        return session.tell("no instance to find others alike: select some")
    if not similarity.can_compare(session.store, state.run):
        told = f"run {state.run} has no embeddings to compare; `s2r precompute` makes them"
        return session.tell(told)
    function = "sim.like" if state.side == "sim" else "like"
    return session.choose(f"{function}({state.cursor}, {NEIGHBOURS})")


_OPERATORS = (
    Action(
        "intersect", ("ampersand",), "select", "next selection: only what both have",
        lambda s: s.expect("intersect"), "and", "&", "still",
    ),
    Action(
        "union", ("vertical_line",), "select", "next selection: in addition",
        lambda s: s.expect("union"), "", "|", "still",
    ),
    Action(
        "subtract", ("minus",), "select", "next selection: taken out",
        lambda s: s.expect("subtract"), "", "-", "still",
    ),
    Action(
        "complement", ("exclamation_mark",), "select", "all but these",
        Session.complement, "", "!", "still",
    ),
)  # fmt: skip

_BRUSHING = (
    Action("brush", ("x",), "brush", "brush in this view, by keys", short="brush", when="still"),
    Action("brush_apply('')", ("enter",), "brush", "select what is inside", short="select",
           when="brushing"),
    Action("brush_apply('intersect')", ("ampersand",), "brush", "... intersected with the present",
           short="and", shown="&", when="brushing"),
    Action("brush_apply('union')", ("vertical_line",), "brush", "... in addition",
           short="or", shown="|", when="brushing"),
    Action("brush_apply('subtract')", ("minus",), "brush", "... taken out",
           short="less", shown="-", when="brushing"),
    Action("brush_move(-1, 0)", ("left",), "brush", "move the mark", shown="arrows",
           short="move", when="brushing"),
    Action("leave", ("escape",), "brush", "leave a mark, an operator, a line",
           short="leave", when="begun"),
    Action("brush_move(1, 0)", ("right",), "brush", "", when="brushing"),
    Action("brush_move(0, -1)", ("up",), "brush", "", when="brushing"),
    Action("brush_move(0, 1)", ("down",), "brush", "", when="brushing"),
    Action("brush_stretch(-1, 0)", ("shift+left",), "brush", "move its far corner",
           shown="shift+arrows", when="brushing"),
    Action("brush_stretch(1, 0)", ("shift+right",), "brush", "", when="brushing"),
    Action("brush_stretch(0, -1)", ("shift+up",), "brush", "", when="brushing"),
    Action("brush_stretch(0, 1)", ("shift+down",), "brush", "", when="brushing"),
    Action("brush_scale(-1)", ("z",), "brush", "smaller", short="smaller", when="brushing"),
    Action("brush_scale(1)", ("Z",), "brush", "larger", short="larger", when="brushing"),
    Action("brush_corner", ("space",), "brush", "a corner of the lasso", when="brushing"),
    Action("brush_panel", ("tab",), "brush", "the view's next panel", short="panel",
           when="brushing"),
    Action("lasso", ("L",), "brush", "brush with a lasso or a box"),
)  # fmt: skip

_ADJUSTING = (
    Action("adjust", ("a",), "adjust", "adjust images live", short="adjust", when="plain",
           needs="models"),
    Action("slider_up", ("up",), "adjust", "another slider",
           lambda s: adjusting.choose(s, -1), shown="up, down", when="adjust"),
    Action("slider_down", ("down",), "adjust", "", lambda s: adjusting.choose(s, 1),
           when="adjust"),
    Action("less", ("left",), "adjust", "move the slider; with shift five steps",
           lambda s: adjusting.move(s, -1), "slider", "<- ->", "adjust"),
    Action("more", ("right",), "adjust", "", lambda s: adjusting.move(s, 1), when="adjust"),
    Action("much_less", ("shift+left",), "adjust", "", lambda s: adjusting.move(s, -5),
           when="adjust"),
    Action("much_more", ("shift+right",), "adjust", "", lambda s: adjusting.move(s, 5),
           when="adjust"),
    Action("neutral", ("backspace",), "adjust", "all sliders to neutral", adjusting.reset,
           "neutral", when="adjust"),
    Action("save_run", ("S",), "adjust", "save the adjustments as a run, for all images",
           short="save run", when="adjust", needs="models"),
)  # fmt: skip

ACTIONS: tuple[Action, ...] = (
    Action("worst_real", ("w",), "select", "worst 15 % in reality (min)", _choose("worst15"),
           "worst", when="still"),
    Action("best_real", ("b",), "select", "best 15 % in reality (max)", _choose("best15"),
           "best", when="still"),
    Action("worst_sim", ("W",), "select", "worst 15 % in simulation",
           _choose("worst(15%, sim.error)"), when="still"),
    Action("best_sim", ("B",), "select", "best 15 % in simulation",
           _choose("best(15%, sim.error)"), when="still"),
    Action("straight", ("i",), "select", "straight driving", _choose("straight"), when="still"),
    Action("curved", ("j",), "select", "curves", _choose("curved"), when="still"),
    Action("alike", ("l",), "select", "what the model sees like this instance", _choose_alike,
           when="still"),
    Action("all", ("c",), "select", "select all", lambda s: s.select("all"), "clear",
           when="still"),
    *_OPERATORS,
    *_BRUSHING,
    *_ADJUSTING,
    Action("edit", ("slash",), "select", "write an expression", None, "query", "/", "still"),
    Action("undo", ("u",), "select", "the expression before this one", Session.undo),
    Action("redo", ("U",), "select", "the expression after this one", Session.redo),
    Action("copy", ("y",), "select", "copy the expression to the clipboard"),
    Action("save_selection", ("at",), "select", "save the selection by name", shown="@"),
    Action("write_selection", ("F",), "select", "write the selection: CSV, JSON, Parquet"),
    Action("selections", ("f",), "select", "saved selections and history"),
    Action("next_instance", ("n",), "move", "next instance",
           lambda s: s.move_cursor(1), when="still"),
    Action("previous_instance", ("p",), "move", "previous instance",
           lambda s: s.move_cursor(-1), when="still"),
    Action("instance_right", ("right",), "move", "next instance",
           lambda s: s.move_cursor(1), "instance", "->", "plain"),
    Action("instance_left", ("left",), "move", "previous instance",
           lambda s: s.move_cursor(-1), "", "<-", "plain"),
    Action("next_row", ("down",), "move", "next row of the list",
           lambda s: instance_list.move(s, 1), when="list"),
    Action("previous_row", ("up",), "move", "previous row of the list",
           lambda s: instance_list.move(s, -1), when="list"),
    Action("page_down", ("pagedown",), "move", "a page of the list onwards",
           lambda s: instance_list.move(s, 20), when="list"),
    Action("page_up", ("pageup",), "move", "a page of the list back",
           lambda s: instance_list.move(s, -20), when="list"),
    Action("next_run", ("r",), "move", "next run", lambda s: s.change_run(1), "run",
           when="still"),
    Action("previous_run", ("R",), "move", "previous run", lambda s: s.change_run(-1),
           when="still"),
    Action("run_below", ("down",), "move", "next run", lambda s: s.change_run(1),
           when="elsewhere"),
    Action("run_above", ("up",), "move", "previous run", lambda s: s.change_run(-1),
           when="elsewhere"),
    Action("trajectory", ("t",), "move", "next trajectory in view", Session.change_trajectory,
           when="still"),
    Action("next_heat", ("h",), "heat", "next heatmap kind",
           partial(display.change_heat, steps=1), "heat"),
    Action("previous_heat", ("H",), "heat", "previous heatmap kind",
           partial(display.change_heat, steps=-1)),
    Action("mode", ("v",), "heat", "next mode of the kind", display.change_mode),
    Action("overlay", ("o",), "heat", "heat on the map: off, instance, selection, run",
           display.change_overlay, "on map"),
    Action("aggregate", ("A",), "heat", "heat on the map: mean, max, sum, count",
           display.change_aggregate),
    Action("side", ("d",), "heat", "side that is shown: real or sim", display.change_side),
    Action("map_mode", ("m",), "map", "map: colour, glyph or full", display.change_map_mode,
           "map"),
    Action("zoom_in", ("z", "plus", "equals_sign"), "map", "zoom in at the instance",
           partial(display.zoom, factor=1 / 0.6), when="still"),
    Action("zoom_out", ("Z",), "map", "zoom out", partial(display.zoom, factor=0.6),
           when="still"),
    Action("zoom_all", ("0",), "map", "the whole map", partial(display.zoom, factor=0)),
    Action("pan_left", ("shift+left",), "map", "move the map",
           partial(display.pan, across=-0.2, down=0), shown="shift+arrows", when="plain"),
    Action("pan_right", ("shift+right",), "map", "", partial(display.pan, across=0.2, down=0),
           when="plain"),
    Action("pan_up", ("shift+up",), "map", "", partial(display.pan, across=0, down=-0.2),
           when="still"),
    Action("pan_down", ("shift+down",), "map", "", partial(display.pan, across=0, down=0.2),
           when="still"),
    Action("clip", ("C",), "map", "dim what the selection has not seen", display.toggle_clip),
    Action("room_names", ("N",), "map", "room names", display.toggle_room_names),
    Action("sort", ("full_stop",), "review", "list: sort by the next column",
           instance_list.next_column, shown="."),
    Action("reverse", ("comma",), "review", "list: reverse the order", instance_list.reverse,
           shown=","),
    Action("other_run", ("k",), "review", "compare with the next run", display.change_other),
    Action("note", ("e",), "review", "note on this instance"),
    Action("tag", ("number_sign",), "review", "tag this instance", shown="#"),
    *(
        Action(f"view('{view.name}')", (view.key,), "views", view.description)
        for view in VIEWS
        if view.from_store
    ),
    Action("next_view", ("tab",), "views", "next view", short="view", when="still"),
    Action("previous_view", ("shift+tab",), "views", "previous view", when="still"),
    Action("jump", ("space",), "views", "jump to anything by a letter", when="still"),
    Action("move_on", ("g",), "program", "move on to the newest generation", Session.move_on),
    Action("snapshot", ("s",), "program", "write the screen as PNG", short="snapshot"),
    Action("report", ("E",), "program", "write a report of the saved selections (HTML)"),
    Action("doctor", ("D",), "program", "what this terminal can do"),
    Action("tour", ("T",), "program", "the tour again"),
    Action("help", ("question_mark",), "program", "all keys", short="help", shown="?"),
    Action("quit", ("q",), "program", "quit", short="quit"),
)  # fmt: skip
BY_NAME = {action.name: action for action in ACTIONS}


def named(call: str, parameters: tuple[object, ...] = ()) -> Action | None:
    """The action that Textual calls by a name and parameters; None where it is not registered."""
    if call == "do":
        return BY_NAME.get(str(parameters[0]))
    listed = ", ".join(repr(parameter) for parameter in parameters)
    return BY_NAME.get(f"{call}({listed})" if parameters else call)


def offered(access: Permissions | None = None) -> list[Action]:
    """The actions that a session may run at all."""
    return [action for action in ACTIONS if access is None or access.allows(action.needs)]


def footer(width: int, state: State, access: Permissions | None = None) -> list[tuple[str, str]]:
    """Pairs of key and word that fit into `width` columns; help and quit always do, if anything."""
    applicable = [a for a in offered(access) if a.short and a.applies(state)]
    words = [(action.key, action.short) for action in applicable]
    last = [pair for pair in words if pair[1] in ("help", "quit")]
    room = width - sum(len(key) + len(word) + 3 for key, word in last)
    shown = []
    for key, word in words:
        if (key, word) not in last and len(key) + len(word) + 3 <= room:
            room -= len(key) + len(word) + 3
            shown.append((key, word))
    return [*shown, *last]


def help_text(access: Permissions | None = None) -> str:
    """All actions that are offered, by group, in plain text."""
    lines = []
    for group, title in GROUPS.items():
        lines.append(title)
        lines += [
            f"  {action.all_keys:<18}{action.description}"
            for action in offered(access)
            if action.group == group and action.description
        ]
        lines.append("")
    return "\n".join(lines).rstrip()
