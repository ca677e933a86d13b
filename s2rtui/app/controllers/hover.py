"""The instance under the mouse, described in the message line."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SIDES
from s2rtui.app.widgets.plot import Cell, PlotView
from s2rtui.charts.registry import BY_NAME
from s2rtui.session.state import State
from s2rtui.session.targets import run_is_loaded

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp


class HoverController:
    """Finds the instance under the mouse."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._under: int | None = None
        self._state = app.session.state

    @property
    def text(self) -> str:
        """The instance under the mouse in one line; empty if there is none.

        A message that is newer than the mouse's arrival there hides it.
        """
        state = self._app.session.state
        is_hidden = state.message and state is not self._state
        return "" if is_hidden else self._text_of(self._under)

    @property
    def cursor_text(self) -> str:
        """The cursor's instance in one line; empty if there is none."""
        return self._text_of(self._app.session.state.cursor)

    def on_hovered(self, message: PlotView.Hovered) -> None:
        """Describe the instance under the mouse, if it is another one than before."""
        view, cell = message.plot.take_hover()
        found = None if cell is None else self._instance_at(view, cell)
        if found != self._under:
            self._under, self._state = found, self._app.session.state
            self._app.updater.refresh_message()

    def _instance_at(self, name: str, cell: Cell) -> int | None:
        app = self._app
        if name not in BY_NAME or app.screen is not app.default_screen:
            return None
        view = BY_NAME[name]
        if (panel := app.brush.panel_under(view, cell)) is None:
            return None
        place = app.brush.place_of(view, cell)
        return view.instance_at(app.updater.scene, panel, place)

    def _text_of(self, iid: int | None) -> str:
        store, state = self._app.session.store, self._app.session.state
        return instance_text(store, state, iid) if iid is not None and iid < len(state.base) else ""


def instance_text(store: Store, state: State, iid: int) -> str:
    """`#41 kitchen, sim 0.12 m, real 3.45 m, gap +3.33 m`; errors as far as they are loaded."""
    truth = store.instances
    trajectory = truth.trajectory_names[truth.trajectory[iid]]
    room = truth.room_names[truth.room[iid]] if truth.room[iid] >= 0 else "no room"
    parts = [f"#{iid} {room if store.has_poses else f'{trajectory} {truth.seq[iid]}'}"]
    if state.run == NO_RUN or not run_is_loaded(store, state.run):
        return parts[0]
    columns = store.run_columns(state.run)
    errors = {side: float(columns.side(side).error[iid]) for side in SIDES}
    parts += [
        f"{side} n/a" if math.isnan(error) else f"{side} {error:.2f} m"
        for side, error in errors.items()
    ]
    if not math.isnan(gap := errors["real"] - errors["sim"]):
        parts.append(f"gap {gap:+.2f} m")
    return ", ".join(parts)
