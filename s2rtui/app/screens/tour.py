"""The first-run tour: one screen that says what is seen and which keys matter first."""

from __future__ import annotations

from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from s2rtui.app.actions import BY_NAME
from s2rtui.app.screens.modal import ModalBase

_STEPS = (
    ("worst_real", "the 15 % that are worst in reality; b the best; W and B in sim"),
    ("intersect", "then another selection: what both have; | adds, - takes out"),
    ("brush", "draw a box in the view with the bright title; arrows, enter"),
    ("edit", "write an expression: worst15 & room:kitchen - @done"),
    ("next_instance", "the next image of the selection, and what the model said"),
    ("next_run", "the next model or adjustment; 9 compares two of them"),
    ("next_heat", "the next heatmap; o lays it on the map"),
    ("next_view", "the next view; digits choose one, space jumps by a letter"),
    ("undo", "the selection before this one; U forward again"),
)


def tour_text() -> str:
    """The tour, with the keys as the registry has them."""
    lines = [
        "One model looks at paired images: sim is blue, real is red, truth is",
        "gold. The map shows where they were taken; the first selection is a",
        "finding: the room where the model fails most in reality.",
        "",
    ]
    lines += [f"  {BY_NAME[name].key:<5}{text}" for name, text in _STEPS]
    help_key = BY_NAME["help"].key
    return "\n".join([*lines, "", f"  {help_key}    all keys", "", "any key begins"])


class TourScreen(ModalBase[None]):
    """Any key leaves it."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape,enter,space,q", "dismiss", "begin")]

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="tour"):
            title = "Where and why does the model fail in reality?"
            yield Static(title, id="tour-title", markup=False)
            yield Static(tour_text(), markup=False)

    def on_key(self, event: events.Key) -> None:
        event.stop()
        self.dismiss()
