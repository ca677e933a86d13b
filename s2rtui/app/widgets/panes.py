"""The views' container: children stand where a function of its size puts them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from textual.app import ComposeResult
from textual.geometry import NULL_OFFSET, NULL_SPACING, Region, Size
from textual.layout import ArrangeResult, Layout, WidgetPlacement
from textual.message import Message
from textual.widget import Widget

from s2rtui.app.layout import PaneRectangle
from s2rtui.app.widgets.plot import PlotView

Places = Callable[[int, int], Mapping[str, PaneRectangle]]


BARS = 3
"""Rows of the screen that are not the panes'."""


class PaneLayout(Layout):
    """Places children by their id; those without a place are not shown."""

    name = "panes"

    def __init__(self, places: Places) -> None:
        self._places = places

    def arrange(
        self, parent: Widget, children: list[Widget], size: Size, greedy: bool = True
    ) -> ArrangeResult:
        placed = self._places(size.width, size.height)
        found = []
        for order, child in enumerate(children):
            place = placed.get(child.id or "")
            if place is not None and place.width > 0 and place.height > 0:
                region = Region(place.x, place.y, place.width, place.height)
                found.append(WidgetPlacement(region, NULL_OFFSET, NULL_SPACING, child, order))
        return found


class Panes(Widget, can_focus=False):
    """Holds the views; knows which of them have a place."""

    @dataclass
    class Arranged(Message):
        """The container has another size."""

    def __init__(self, views: list[PlotView], places: Places) -> None:
        super().__init__(id="views")
        self._views = views
        self._places = places
        self._pane_layout = PaneLayout(places)
        self._seen: tuple[object, ...] = ()

    @property
    def layout(self) -> Layout:
        return self._pane_layout

    def compose(self) -> ComposeResult:
        yield from self._views

    def on_resize(self) -> None:
        self.post_message(self.Arranged())

    def _room(self) -> tuple[int, int]:
        """The size, or before the first layout what it will be."""
        if self.size.area:
            return self.size.width, self.size.height
        return self.app.size.width, max(0, self.app.size.height - BARS)

    def place(self, key: tuple[object, ...]) -> None:
        """Ask for the places anew where what they depend on has changed."""
        places = self._places(*self._room())
        for view in self._views:
            view.placed = (view.id or "") in places
            if not view.placed:
                view.abandon()
        if key != self._seen:
            self._seen = key
            self._views[0].refresh(layout=True)  # a child's wish makes its parent arrange anew
