"""An action of the application: its keys, texts, and the situation in which it is available."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from textual.keys import KEY_NAME_REPLACEMENTS

from s2rstore.index.catalog import NO_POSES
from s2rtui.charts.registry import VIEWS
from s2rtui.security import Capability
from s2rtui.session.session import Session
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rstore.reader import Store
    from s2rtui.app.app import S2RApp

Group = Literal["select", "brush", "move", "heat", "map", "adjust", "review", "views", "program"]
When = Literal[
    "always", "begun", "still", "plain", "brushing", "list", "adjust", "groups", "not groups",
    "rows", "rows of instances", "instance", "sheet", "pivot", "suggestions", "drives",
    "not sheet", "elsewhere",
]  # fmt: skip

GROUPS: dict[Group, str] = {group: group.capitalize() for group in get_args(Group)}

_TABLES = tuple(view.name for view in VIEWS if view.has_rows)
_OF_RUNS = ("alike", "other_run", "map_mode", "map_value", "clip")
"""Actions outside of the groups adjust and heat that need a computed run."""


@dataclass(frozen=True, slots=True)
class Action:
    """One action with a unique `name`.

    `do` changes the session, `command` calls a controller of the application; with neither, the
    application has a method `action_NAME`. `key_names` are Textual's names, separated by commas;
    the first one is displayed (as `shown`). `short` is the label in the footer, if any. `when` is
    the situation in which the keys mean this action, `needs` the permission that it requires.
    """

    name: str
    key_names: str
    group: Group
    description: str
    do: Callable[[Session], object] | None = None
    short: str = ""
    shown: str = ""
    when: When = "always"
    needs: Capability = ""
    command: Callable[[S2RApp], object] | None = None

    @property
    def needs_poses(self) -> bool:
        """Whether it does nothing in a data set without poses."""
        return self.group in ("adjust", "heat", "map") or self.name in ("alike", "other_run")

    def unavailable(self, store: Store) -> str:
        """Why it does nothing in a store, in one line; empty if it does something."""
        if self.needs_poses and not store.has_poses:
            return NO_POSES
        needs_run = self.group in ("adjust", "heat") or self.name in _OF_RUNS
        return store.missing_run if needs_run else ""

    @property
    def keys(self) -> list[str]:
        return self.key_names.split(",")

    @property
    def key(self) -> str:
        return self.shown or key_label(self.keys[0])

    @property
    def all_keys(self) -> str:
        """All keys, as `z  +  =`; a label for a group of keys replaces all names."""
        if " " in self.shown:
            return self.shown
        return "  ".join([self.key, *(key_label(name) for name in self.keys[1:])])

    @property
    def call(self) -> str:
        """The action string for Textual."""
        is_method = self.do is None and self.command is None
        return self.name if is_method else f"do('{self.name}')"

    def applies(self, state: State) -> bool:
        """Whether the action is available in a state."""
        brushing = state.brush is not None
        return {
            "always": True,
            "begun": brushing
            or state.operator != "replace"
            or state.is_error
            or state.chosen_row("objects") is not None,
            "still": not brushing,
            "plain": not brushing and state.view != "adjust",
            "adjust": not brushing and state.view == "adjust",
            "brushing": brushing,
            "list": not brushing and state.view == "list",
            "instance": not brushing and state.view == "instance",
            "sheet": state.view == "sheet",
            "pivot": state.view == "pivot",
            "suggestions": state.view == "suggestions",
            "drives": state.view == "drives",
            "not sheet": not brushing and state.view not in ("adjust", "sheet", "pivot", "drives"),
            "groups": not brushing and state.view == "rooms",
            "not groups": state.view != "rooms",
            "rows": not brushing and state.view in _TABLES,
            "rows of instances": not brushing
            and state.view in _TABLES
            and state.view != "suggestions",
            "elsewhere": not brushing and state.view not in ("list", "sheet", "adjust", *_TABLES),
        }[self.when]


_WORDS = {"pagedown": "page down", "pageup": "page up"}


def key_name(character: str) -> str:
    """Textual's name of the key that types a character."""
    if character.isalnum():
        return character
    name = unicodedata.name(character).lower().replace(" ", "_").replace("-", "_")
    return KEY_NAME_REPLACEMENTS.get(name, name)


_CHARACTERS = {key_name(character): character for character in map(chr, range(33, 127))}


def key_label(name: str) -> str:
    """The ASCII label of a Textual key name: `=` for `equals_sign`, `shift+left` unchanged."""
    *held, last = name.split("+") if len(name) > 1 else [name]
    return "+".join([*held, _CHARACTERS.get(last, _WORDS.get(last, last))])
