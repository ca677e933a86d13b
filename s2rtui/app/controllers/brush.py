"""Brushing in every view: keys and mouse make a mark, the mark makes a selection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import cast

from s2rstore.errors import RequestError, S2RError
from s2rtui.app.controllers.base import Desk
from s2rtui.app.widgets.plot import Cell, PlotView, Stroke
from s2rtui.canvas.brush import Panel, panel_at
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.view import View
from s2rtui.session import brushing, display, instance_list
from s2rtui.session.state import Brush, Operator

TITLE_ROWS = 1
_ZOOM = 1 / 0.8
_MOST_TURNS = 100
"""Of the wheel at a time; far more than lie between the whole map and the closest view."""


class Brushes(Desk):
    """The actions and mouse messages of brushing."""

    _grip: tuple[tuple[str, Cell], Panel] | None = None
    """Where a stroke began, and its panel."""

    def _panels(self, view: View) -> Sequence[Panel]:
        """The panels of a view as it stands on the screen; none where it is hidden."""
        widget = self.query_one(f"#{view.name}", PlotView)
        width, height = widget.size
        if not widget.placed or height <= TITLE_ROWS:
            return ()
        return view.panels(self.scene, (width, height - TITLE_ROWS), self.look)

    def _held(self) -> tuple[Brush, Panel] | None:
        """The present brush and its panel; None where there is none on the screen."""
        brush = self.session.state.brush
        if brush is None:
            return None
        panels = self._panels(BY_NAME[brush.view])
        panel = next((one for one in panels if one.name == brush.mark.panel), None)
        return None if panel is None else (brush, panel)

    def _put(self, brush: Brush | None) -> None:
        self.session.change(brush=brush)
        self.refresh_views()

    # --- keys --------------------------------------------------------------------------------

    def action_brush(self) -> None:
        view, panels = self.active, self._panels(self.active)
        if not panels or not view.brushable:
            self.session.tell(f"nothing to brush in {view.name}: choose the map, a chart, ...")
            self.refresh_views()
            return
        side = self.session.state.side
        panel = next((one for one in panels if one.name in (side, self.session.state.run)), None)
        self._begin(view, panel or panels[0])

    def _begin(self, view: View, panel: Panel) -> None:
        at = view.cursor_point(self.scene, panel)
        self._put(brushing.begun(view.name, panel, at, self.session.state.lasso))

    def action_brush_panel(self) -> None:
        held = self._held()
        if held is not None:
            view = BY_NAME[held[0].view]
            panels = list(self._panels(view))
            names = [panel.name for panel in panels]
            at = names.index(held[1].name)
            self._begin(view, panels[(at + 1) % len(panels)])

    def action_brush_move(self, across: int, down: int) -> None:
        if (held := self._held()) is not None:
            self._put(brushing.moved(*held, across, down))

    def action_brush_stretch(self, across: int, down: int) -> None:
        if (held := self._held()) is not None:
            self._put(brushing.stretched(*held, across, down))

    def action_brush_scale(self, steps: int) -> None:
        if (held := self._held()) is not None:
            self._put(brushing.scaled(*held, steps))

    def action_brush_corner(self) -> None:
        if (held := self._held()) is not None and held[0].mark.lasso:
            self._put(brushing.cornered(held[0]))

    def action_brush_apply(self, operator: str) -> None:
        held = self._held()
        if held is None:
            self._put(None)
            return
        self.drop_drag()  # the mouse would apply it again where it lets go
        self._apply(*held, cast(Operator, operator) if operator else None)

    def action_lasso(self) -> None:
        state = self.session.state
        told = "brushes draw a lasso" if not state.lasso else "brushes draw a box"
        self.session.change(lasso=not state.lasso, brush=None, message=told)
        self.refresh_views()

    def _apply(self, brush: Brush, panel: Panel, operator: Operator | None = None) -> bool:
        """Select what is inside, joined by an operator (default: the pending one)."""
        view, mark, before = BY_NAME[brush.view], brush.mark, self.session.state
        try:
            if mark.lasso:
                mark = replace(mark, points=brushing.outline(brush))
                if len(mark.points) < 3:
                    raise RequestError("a lasso needs three corners: space sets one")
            meaning = view.to_expression(self.scene, panel, mark)
            self.session.set(replace(before, operator=operator or before.operator))
            self.session.choose(meaning)
        except S2RError as error:
            self.session.set(before)
            self.refuse(error)
            return False
        self.refresh_views()
        return True

    # --- the mouse ---------------------------------------------------------------------------

    @property
    def dragging(self) -> bool:
        """Whether the mouse is drawing a mark or moving a slider."""
        return any(plot.dragging for plot in self.query(PlotView))

    def drop_drag(self) -> None:
        """End what the mouse has begun, without a mark."""
        begun = [plot for plot in self.query(PlotView) if plot.abandon()]
        self._grip = None
        if begun:
            self.session.set(replace(self.session.state, brush=None))

    def _under(self, view: View, cell: Cell) -> Panel | None:
        return panel_at(self._panels(view), cell[0], cell[1] - TITLE_ROWS)

    def on_plot_view_pressed(self, message: PlotView.Pressed) -> None:
        if message.view not in BY_NAME:
            return  # a drawing on a screen above the views
        view = BY_NAME[message.view]
        panel = self._under(view, message.cell)
        display.activate(self.session, view.name)
        if panel is not None:
            middle = message.cell[0] + 0.5, message.cell[1] - TITLE_ROWS + 0.5
            try:
                view.click(self.session, self.scene, panel, panel.to_data(*middle))
            except S2RError as error:
                self.session.tell(str(error), is_error=True)
        self.refresh_views()

    def _gripped(self, stroke: Stroke) -> Panel | None:
        """The panel that a stroke began on, wherever its view has moved it meanwhile."""
        begun, view = (stroke.view, stroke.start), BY_NAME[stroke.view]
        if self._grip is None or self._grip[0] != begun:
            panel = self._under(view, stroke.start)
        else:
            held = self._grip[1]
            panel = next((one for one in self._panels(view) if one.name == held.name), held)
        self._grip = None if panel is None or stroke.done else (begun, panel)
        return panel

    def on_plot_view_dragged(self, message: PlotView.Dragged) -> None:
        stroke = message.taken()
        if stroke.view not in BY_NAME:
            return
        view = BY_NAME[stroke.view]
        if not stroke.done and not self.query_one(f"#{view.name}", PlotView).dragging:
            return  # it was dropped
        panel = self._gripped(stroke)
        if panel is None:
            return
        display.activate(self.session, view.name)
        start, *trail = ((x + 0.5, y - TITLE_ROWS + 0.5) for x, y in (stroke.start, *stroke.trail))
        if view.drag(self.session, self.scene, panel, panel.to_data(*trail[-1])):
            self.refresh_views()
            return
        lasso = (start, *trail) if self.session.state.lasso else ()
        brush = brushing.dragged(view.name, panel, start, trail[-1], lasso)
        if not stroke.done:
            self._put(brush)
        elif not self._apply(brush, panel):
            self.session.set(replace(self.session.state, brush=None))
            self.refresh_views()

    def on_plot_view_wheeled(self, message: PlotView.Wheeled) -> None:
        turn = message.taken()
        if turn.view not in BY_NAME or not turn.steps:
            return
        view = BY_NAME[turn.view]
        panel = self._under(view, turn.cell)
        if view.name == "map" and panel is not None:
            at = panel.to_data(turn.cell[0] + 0.5, turn.cell[1] - TITLE_ROWS + 0.5)
            steps = max(-_MOST_TURNS, min(turn.steps, _MOST_TURNS))
            display.zoom(self.session, _ZOOM**steps, at)
        elif view.name == "list":
            instance_list.move(self.session, -turn.steps)
        self.refresh_views()
