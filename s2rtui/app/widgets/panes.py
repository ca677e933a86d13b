"""The container of the views, laid out by a function of its size."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from textual.app import ComposeResult
from textual.geometry import NULL_OFFSET, NULL_SPACING, Region, Size
from textual.layout import ArrangeResult, Layout, WidgetPlacement
from textual.message import Message
from textual.widget import Widget

from s2rtui.app.widgets.plot import PlotView

Arrange = Callable[[int, int], Mapping[str, Region]]
BARS = 3
"""Rows of the screen used by the bars."""


class PaneLayout(Layout):
    """Places children by their id; those without a rectangle are hidden."""

    name = "panes"

    def __init__(self, arrange: Arrange) -> None:
        self._arrange = arrange

    def arrange(
        self, parent: Widget, children: list[Widget], size: Size, greedy: bool = True
    ) -> ArrangeResult:
        rectangles = self._arrange(size.width, size.height)
        placements = []
        for order, child in enumerate(children):
            region = rectangles.get(child.id or "")
            if region is not None and region.area > 0:
                placements.append(WidgetPlacement(region, NULL_OFFSET, NULL_SPACING, child, order))
        return placements


class Panes(Widget, can_focus=False):
    """Holds the views and tells each whether it is on the screen."""

    @dataclass
    class Arranged(Message):
        """The container was resized."""

    def __init__(self, views: list[PlotView], arrange: Arrange) -> None:
        super().__init__(id="views")
        self._views = views
        self._pane_layout = PaneLayout(arrange)
        self._rectangles: Mapping[str, Region] = {}

    @property
    def layout(self) -> Layout:
        return self._pane_layout

    def compose(self) -> ComposeResult:
        yield from self._views

    def on_resize(self) -> None:
        self.post_message(self.Arranged())

    @property
    def available_size(self) -> tuple[int, int]:
        """The size, estimated from the screen before the first layout."""
        if self.size.area:
            return self.size.width, self.size.height
        return self.app.size.width, max(0, self.app.size.height - BARS)

    def place(self, rectangles: Mapping[str, Region]) -> None:
        """Tell each view whether it has a rectangle; lay them out again if these have changed."""
        for view in self._views:
            view.placed = (view.id or "") in rectangles
            if not view.placed:
                view.abandon()
        if rectangles != self._rectangles:
            self._rectangles = rectangles
            self._views[0].refresh(layout=True)  # makes the parent lay out its children
