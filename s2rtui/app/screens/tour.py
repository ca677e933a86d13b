"""The introduction at the first start: what the screen shows and the first keys."""

from __future__ import annotations

from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import VerticalScroll
from textual.widgets import Static

from s2rtui.app.key_bindings import BY_NAME
from s2rtui.app.screens import ModalBase

_STEPS = (
    ("worst_real", "select the 15 % worst in reality; b the best; W, B in sim"),
    ("intersect", "then another selection: intersect; | adds, - subtracts"),
    ("brush", "brush a box in the active view with arrows and enter"),
    ("edit", "type an expression: worst15 & room:kitchen - @done"),
    ("next_instance", "next instance of the selection: images and predictions"),
    ("next_run", "next run (model or adjustment); 9 compares two runs"),
    ("next_heat", "next heatmap; o shows it on the map"),
    ("next_view", "next view; digits choose one, space jumps by a letter"),
    ("undo", "undo the selection; U redoes it"),
)


def tour_text() -> str:
    """The introduction, with the keys of the registry."""
    lines = [
        "A model estimates poses from paired images: simulation is blue,",
        "reality is red, the ground truth is gold. The map shows where the",
        "images were taken. The room with the worst real errors is selected.",
        "",
    ]
    lines += [f"  {BY_NAME[name].key:<5}{text}" for name, text in _STEPS]
    help_key = BY_NAME["help"].key
    return "\n".join([*lines, "", f"  {help_key}    all keys and terms", "", "any key begins"])


class TourScreen(ModalBase[None]):
    """Any key closes it."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape,enter,space,q", "dismiss", "begin")]

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="tour"):
            title = "Where and why does the model fail in reality?"
            yield Static(title, id="tour-title", markup=False)
            yield Static(tour_text(), markup=False)

    def on_key(self, event: events.Key) -> None:
        event.stop()
        self.dismiss()
