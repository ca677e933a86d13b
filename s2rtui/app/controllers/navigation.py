"""Show views, zoom them and choose rows of their tables, by keys, jump letters and the wheel."""

from __future__ import annotations

from typing import TYPE_CHECKING

from s2rstore.findings import Finding
from s2rtui.app.key_bindings import BY_NAME as ACTIONS
from s2rtui.app.screens.jump import JumpScreen, JumpTarget
from s2rtui.charts.findings import VIEW as FINDINGS
from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.charts.view import View
from s2rtui.session import instance_list, view_settings
from s2rtui.session.view_settings import ZoomPlane

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp
    from s2rtui.app.widgets.plot import PlotView

_WHEEL_ZOOM = 1 / 0.8
_MAX_WHEEL_STEPS = 100
"""Largest zoom of one message; it leads from the whole map to the closest view."""
_CYCLE = [view.name for view in sorted(VIEWS, key=lambda view: view.key) if view.from_store]
_STATUS_ACTIONS = {
    "all trajectories": "trajectory",
    "trajectories": "trajectory",
    "run": "next_run",
    "expression": "edit",
}
"""Actions of the parts of the status line that can be jumped to."""


def _can_zoom(view: View) -> bool:
    """Whether a view has a plane, in stores that it can show."""
    return type(view).zoom_plane is not View.zoom_plane


class NavigationController:
    """Shows views and jumps to targets on the screen; the caller draws the state."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app

    def show_view(self, name: str) -> None:
        """Send the keys to a view, and bring it to the front of its pane if it is hidden."""
        session = self._app.session
        if self._app.updater.is_placed(name):
            session.dispatch(view_settings.activate, name)
        else:
            session.dispatch(view_settings.show_view, name, BY_NAME[name].pane)

    def show_next_view(self, steps: int) -> None:
        """Show the view `steps` keys after the active one."""
        present = self._app.session.state.view
        at = _CYCLE.index(present) if present in _CYCLE else 0
        self.show_view(_CYCLE[(at + steps) % len(_CYCLE)])

    def zoom(self, factor: float) -> None:
        """Zoom the active view at the cursor; factor 0 shows all of it."""
        if (plane := self._plane()) is not None:
            self._app.session.dispatch(view_settings.zoom, plane, factor)

    def pan(self, across: float, down: float) -> None:
        """Move what the active view shows by shares of its size."""
        if (plane := self._plane()) is not None:
            self._app.session.dispatch(view_settings.pan, plane, across, down)

    def on_wheeled(self, message: PlotView.Wheeled) -> None:
        """Zoom the plane of the view, or move through the rows of its table or the list."""
        wheel = message.wheel
        steps = wheel.take_steps()
        if wheel.view not in BY_NAME or not steps:
            return
        view, session = BY_NAME[wheel.view], self._app.session
        panel = self._app.brush.panel_under(view, wheel.cell)
        if view.name == "list":
            session.dispatch(instance_list.move, -steps)
        elif panel is not None and (plane := view.zoom_plane(self._app.updater.scene)) is not None:
            point = panel.to_data(*self._app.brush.place_of(view, wheel.cell))
            steps = max(-_MAX_WHEEL_STEPS, min(steps, _MAX_WHEEL_STEPS))
            at = view.plane_point(self._app.updater.scene, point)
            session.dispatch(view_settings.zoom, plane, _WHEEL_ZOOM**steps, at)
        else:
            self.choose_row(view, -steps)
        self._app.updater.refresh()

    def _plane(self) -> ZoomPlane | None:
        """The plane of the active view; None after a message where it has none."""
        scene = self._app.updater.scene
        view = BY_NAME[scene.state.view]
        is_shown = not view.unavailable(scene.store)
        plane = view.zoom_plane(scene) if is_shown else None
        if plane is None:
            keys = (f"{other.key} {other.name}" for other in VIEWS if _can_zoom(other))
            fill = ACTIONS["fill_screen"].key
            self._app.session.show_message(
                f"{view.name} cannot be zoomed ({', '.join(keys)} can); {fill} fills the screen"
            )
        return plane

    def move_row(self, rows: int) -> None:
        """Move the cursor by some rows of thumbnails of the sheet."""
        panels = self._app.brush.panels(BY_NAME["sheet"])
        across = sum(panel.y == panels[0].y for panel in panels)
        self._app.session.dispatch(instance_list.move, rows * across)

    def open_instance(self) -> None:
        """Show the instance of the cursor on the whole screen."""
        session = self._app.session
        self.show_view("instance")
        if not session.state.fills_screen and not self._app.updater.shows_one_view:
            session.dispatch(view_settings.toggle_full_screen)

    def choose_row(self, view: View, steps: int, across: int = 0, wraps: bool = False) -> None:
        """Choose another row of a view's table, down by some rows; wraps: from end to end."""
        scene = self._app.updater.scene
        names = () if view.unavailable(scene.store) else view.row_names(scene)
        if names:
            present = view.chosen_row(scene)
            present = view.first_choice(scene) if present is None else present
            wide = view.row_width(scene)
            row, column = divmod(present, wide)
            last = len(names) // wide - 1
            row = (row + steps) % (last + 1) if wraps else min(max(row + steps, 0), last)
            name = names[row * wide + min(max(column + across, 0), wide - 1)]
            self._app.session.dispatch(view_settings.choose_row, view.name, name)

    def move_choice(self, steps: int, across: int = 0) -> None:
        """Choose another row of the active view's table, or a cell beside the chosen one."""
        view = BY_NAME[self._app.session.state.view]
        self.choose_row(view, steps, across, wraps=abs(steps) == 1)

    def fill_screen(self) -> None:
        """Fill the screen with the active view, or show all views again."""
        app = self._app
        if app.updater.shows_one_view:
            app.session.show_message("this screen has room for one view, which fills it already")
        else:
            app.session.dispatch(view_settings.toggle_full_screen)

    def open_row(self) -> None:
        """Select the instances of the chosen row of the active view's table.

        The view of a finding is shown; findings that stay on the screen beside it keep the keys.
        """
        app, session = self._app, self._app.session
        view, scene = BY_NAME[session.state.view], app.updater.scene
        row = None if view.unavailable(scene.store) else view.chosen_row(scene)
        if row is None:
            session.show_message(f"{view.name} has no row to select")
        else:
            view.select_row(session, scene, row)
            if view is FINDINGS and (report := FINDINGS.input(scene)) is not None:
                self._show_finding(report.findings[row])

    def _show_finding(self, finding: Finding) -> None:
        app, message = self._app, self._app.session.state.message
        stays = app.updater.is_placed("findings") and app.session.state.centre != "findings"
        self.show_view(finding.view)
        if stays:
            app.session.dispatch(view_settings.activate, "findings")
        app.session.show_message(message)

    def jump(self) -> None:
        """Put a letter on every view and part of the status line; the letter goes there."""
        self._app.push_screen(JumpScreen(self._targets()), self._jump_to)

    def _targets(self) -> list[JumpTarget]:
        regions = self._app.updater.visible_regions()
        targets = [JumpTarget(region.x, region.y, f"view('{name}')") for name, region in regions]
        for part, column in self._app.updater.status_columns().items():
            if part in _STATUS_ACTIONS:
                targets.append(JumpTarget(column, 0, f"do('{_STATUS_ACTIONS[part]}')"))
        return targets

    def _jump_to(self, action: str | None) -> None:
        if action:
            self._app.call_next(self._app.run_action, action)
