"""Every action once: key map, footer, help and palette are made from this table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

Group = Literal["select", "move", "heat", "map", "views", "program"]
Need = Literal["", "models"]

GROUPS: dict[Group, str] = {
    "select": "Select",
    "move": "Move",
    "heat": "Heat",
    "map": "Map",
    "views": "Views",
    "program": "Program",
}


@dataclass(frozen=True, slots=True)
class Action:
    """`name` is the application's method `action_NAME`; `short` the footer's word, if any.

    `keys` are Textual's names, the first one shown. `needs` names what a session must be allowed to
    do for the action to be offered.
    """

    name: str
    keys: tuple[str, ...]
    group: Group
    description: str
    short: str = ""
    shown: str = ""
    needs: Need = ""

    @property
    def key(self) -> str:
        return self.shown or self.keys[0]


ACTIONS: tuple[Action, ...] = (
    Action("worst_real", ("w",), "select", "worst 15 % in reality (min)", "worst"),
    Action("best_real", ("b",), "select", "best 15 % in reality (max)", "best"),
    Action("worst_sim", ("W",), "select", "worst 15 % in simulation"),
    Action("best_sim", ("B",), "select", "best 15 % in simulation"),
    Action("clear", ("c",), "select", "select all", "clear"),
    Action("edit", ("slash",), "select", "write an expression", "query", "/"),
    Action("undo", ("u",), "select", "the expression before this one"),
    Action("copy", ("y",), "select", "copy the expression to the clipboard"),
    Action("next_instance", ("right", "n"), "move", "next instance", "instance", "->"),
    Action("previous_instance", ("left", "p"), "move", "previous instance", "", "<-"),
    Action("next_run", ("r", "down"), "move", "next run", "run"),
    Action("previous_run", ("R", "up"), "move", "previous run"),
    Action("trajectory", ("t",), "move", "next trajectory in view"),
    Action("next_heat", ("h",), "heat", "next heatmap kind", "heat"),
    Action("previous_heat", ("H",), "heat", "previous heatmap kind"),
    Action("mode", ("v",), "heat", "next mode of the kind"),
    Action("overlay", ("o",), "heat", "heat on the map: off, instance, run", "on map"),
    Action("side", ("d",), "heat", "side whose heat lies on the map"),
    Action("map_mode", ("m",), "map", "map: colour or full", "map"),
    Action("zoom_in", ("plus", "equals_sign"), "map", "zoom in at the instance", "", "+ ="),
    Action("zoom_out", ("minus",), "map", "zoom out", "", "-"),
    Action("zoom_all", ("0",), "map", "the whole map"),
    Action("view('overview')", ("1",), "views", "overview", "", ""),
    Action("view('map')", ("2",), "views", "geo-map"),
    Action("view('instance')", ("3",), "views", "instance"),
    Action("move_on", ("g",), "program", "move on to the newest generation"),
    Action("snapshot", ("s",), "program", "write the screen as PNG", "snapshot"),
    Action("help", ("question_mark",), "program", "all keys", "help", "?"),
    Action("quit", ("q",), "program", "quit", "quit"),
)


def footer(width: int, actions: Sequence[Action] = ACTIONS) -> list[tuple[str, str]]:
    """Pairs of key and word that fit into `width` columns; help and quit always do, if anything."""
    words = [(action.key, action.short) for action in actions if action.short]
    last = [pair for pair in words if pair[1] in ("help", "quit")]
    room = width - sum(len(key) + len(word) + 3 for key, word in last)
    shown = []
    for key, word in words:
        if (key, word) not in last and len(key) + len(word) + 3 <= room:
            room -= len(key) + len(word) + 3
            shown.append((key, word))
    return [*shown, *last]


def help_text(actions: Sequence[Action] = ACTIONS) -> str:
    """Actions by group, in plain text."""
    lines = []
    for group, title in GROUPS.items():
        lines.append(title)
        for action in actions:
            if action.group == group:
                keys = action.key if " " in action.key else "  ".join(_keys(action))
                lines.append(f"  {keys:<18}{action.description}")
        lines.append("")
    return "\n".join(lines).rstrip()


def _keys(action: Action) -> list[str]:
    return list(dict.fromkeys([action.key, *action.keys[1:]]))
