"""Brush in every view: keys and mouse draw a mark, and the mark becomes a selection."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from s2rstore.errors import RequestError, S2RError
from s2rtui.app.widgets.plot import Cell, PlotView, Stroke
from s2rtui.canvas import Point, Size
from s2rtui.canvas.marks import PlotArea, panel_at
from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.charts.view import View
from s2rtui.session import brush_geometry, view_settings
from s2rtui.session.state import Brush, Operator

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp


class BrushController:
    """Keys and mouse messages of brushing."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._drag_panel: tuple[tuple[str, Cell], PlotArea] | None = None
        """View and cell where the present stroke began, and the panel there."""

    def panels(self, view: View) -> Sequence[PlotArea]:
        """The panels of a view on the screen; none if it is hidden."""
        size = self._drawn_size(view)
        if size is None:
            return ()
        return view.panels(self._app.updater.scene, size, self._app.render_options)

    def _drawn_size(self, view: View) -> Size | None:
        """Columns and rows of a view on the screen below its title; None if it is hidden."""
        widget = self._app.updater.plot(view.name)
        width, height = widget.size
        if not widget.placed or view.unavailable(self._app.session.store):
            return None
        rows = height - self._app.updater.title_rows(view.name)
        return (width, rows) if rows > 0 else None

    def place_of(self, view: View, cell: Cell) -> Point:
        """The middle of a cell of a widget (column, row) in the view below the title."""
        return cell[0] + 0.5, cell[1] - self._app.updater.title_rows(view.name) + 0.5

    def _present(self) -> tuple[Brush, PlotArea] | None:
        """The brush and its panel; None if there is none on the screen."""
        brush = self._app.session.state.brush
        if brush is None:
            return None
        panels = self.panels(BY_NAME[brush.view])
        panel = next((panel for panel in panels if panel.name == brush.mark.panel), None)
        return None if panel is None else (brush, panel)

    def _show(self, brush: Brush | None) -> None:
        self._app.session.dispatch(view_settings.set_brush, brush)

    # --- keys --------------------------------------------------------------------------------

    def start(self) -> None:
        """Start a brush in the active view, on the panel of the shown side or run."""
        state = self._app.session.state
        view = BY_NAME[state.view]
        panels = self.panels(view)
        if not panels or not view.brushable:
            self._app.session.show_message(
                f"nothing to brush in {view.name}: choose the map or a chart"
            )
            return
        names = (state.side, state.run)
        self._start_on(view, next((p for p in panels if p.name in names), panels[0]))

    def _start_on(self, view: View, panel: PlotArea) -> None:
        point = view.cursor_point(self._app.updater.scene, panel)
        self._show(brush_geometry.started(view.name, panel, point, self._app.session.state.lasso))

    def next_panel(self) -> None:
        """Start the brush again on the next panel of its view."""
        if (present := self._present()) is not None:
            view = BY_NAME[present[0].view]
            panels = list(self.panels(view))
            at = [panel.name for panel in panels].index(present[1].name)
            self._start_on(view, panels[(at + 1) % len(panels)])

    def transform(self, function: Callable[..., Brush], *steps: int) -> None:
        """Show the brush after `function(brush, panel, *steps)` of `brush_geometry`."""
        if (present := self._present()) is not None:
            self._show(function(*present, *steps))

    def set_corner(self) -> None:
        """Fix the lasso's loose end as a corner."""
        if (present := self._present()) is not None and present[0].mark.lasso:
            self._show(brush_geometry.with_corner(present[0]))

    def apply(self, operator: Operator | None) -> None:
        """Select the instances inside, combined by an operator (default: the pending one)."""
        if (present := self._present()) is None:
            self._show(None)
            return
        self.drop_drag()  # otherwise releasing the mouse button would apply it again
        self._select(*present, operator)

    def toggle_lasso(self) -> None:
        """Switch between lasso and box; the brush that is drawn is converted."""
        present = self._present()
        self._app.session.dispatch(view_settings.toggle_lasso, present[1] if present else None)

    def _select(self, brush: Brush, panel: PlotArea, operator: Operator | None = None) -> None:
        """Select the instances inside; raises S2RError, and the brush stays."""
        view, mark = BY_NAME[brush.view], brush.mark
        if mark.lasso:
            mark = replace(mark, points=brush_geometry.outline(brush))
            if len(mark.points) < 3:
                raise RequestError("a lasso needs three corners: space sets one")
        expression = view.to_expression(self._app.updater.scene, panel, mark)
        self._app.session.select(expression, operator)

    # --- the mouse ---------------------------------------------------------------------------

    @property
    def is_dragging(self) -> bool:
        """Whether the mouse is drawing a mark or moving a slider."""
        return any(self._app.updater.plot(view.name).dragging for view in VIEWS)

    def drop_drag(self) -> None:
        """End an unfinished mouse stroke without a mark."""
        dropped = [view for view in VIEWS if self._app.updater.plot(view.name).abandon()]
        self._drag_panel = None
        if dropped:
            self._app.session.dispatch(view_settings.drop_brush)

    def panel_under(self, view: View, cell: Cell) -> PlotArea | None:
        """The panel of a view under a cell of its widget, which begins with the title."""
        row = cell[1] - self._app.updater.title_rows(view.name)
        return panel_at(self.panels(view), cell[0], row)

    def on_pressed(self, message: PlotView.Pressed) -> None:
        """Activate the clicked view and pass it the click."""
        if message.view not in BY_NAME:
            return  # a plot on a modal screen
        view, session = BY_NAME[message.view], self._app.session
        panel = self.panel_under(view, message.cell)
        session.dispatch(view_settings.activate, view.name)
        if panel is not None:
            middle = self.place_of(view, message.cell)
            try:
                view.click(session, self._app.updater.scene, panel, panel.to_data(*middle))
            except S2RError as error:
                session.show_message(str(error), is_error=True)
        self._app.updater.refresh()

    def _stroke_panel(self, stroke: Stroke) -> PlotArea | None:
        """The panel that a stroke began on, where its view shows it now."""
        start, view = (stroke.view, stroke.start), BY_NAME[stroke.view]
        if self._drag_panel is None or self._drag_panel[0] != start:
            panel = self.panel_under(view, stroke.start)
        else:
            known = self._drag_panel[1]
            panel = next((p for p in self.panels(view) if p.name == known.name), known)
        self._drag_panel = None if panel is None or stroke.done else (start, panel)
        return panel

    def on_dragged(self, message: PlotView.Dragged) -> None:
        """Draw the mark of a stroke, or let the view handle the drag; select at its end."""
        stroke = message.drag.taken()
        if stroke.view not in BY_NAME:
            return
        view, session = BY_NAME[stroke.view], self._app.session
        if not stroke.done and not self._app.updater.plot(view.name).dragging:
            return  # the stroke was dropped meanwhile
        panel = self._stroke_panel(stroke)
        if panel is None:
            return
        session.dispatch(view_settings.activate, view.name)
        left, top = self.place_of(view, (0, 0))
        start, *trail = ((x + left, y + top) for x, y in (stroke.start, *stroke.trail))
        is_handled = view.drag(session, self._app.updater.scene, panel, panel.to_data(*trail[-1]))
        if not is_handled and view.brushable:
            lasso = (start, *trail) if session.state.lasso else ()
            brush = brush_geometry.dragged(view.name, panel, start, trail[-1], lasso)
            try:
                if stroke.done:
                    self._select(brush, panel)
                else:
                    self._show(brush)
            except S2RError as error:
                session.show_message(str(error), is_error=True)
                session.dispatch(view_settings.drop_brush)
        self._app.updater.refresh()
