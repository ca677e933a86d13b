"""The application: keys change the session's state, and every view draws that one state."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from textual import events, work
from textual.app import ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical
from textual.content import Content
from textual.screen import Screen
from textual.timer import Timer
from textual.widgets import Input

from s2rstore.errors import S2RError
from s2rstore.language import ExpressionError
from s2rtui import plots
from s2rtui.access import Access
from s2rtui.access.guard import GuardedApp
from s2rtui.actions import ACTIONS, footer
from s2rtui.canvas import Canvas, ColourMode, Look
from s2rtui.messages import FloorPlanReady, PicturesReady
from s2rtui.session import Session, State, derive
from s2rtui.session import heat as heat_source
from s2rtui.session.state import View
from s2rtui.themes import textual_theme
from s2rtui.titles import status_markup, titled
from s2rtui.widgets import Bar, PlotView
from s2rtui.widgets.help import HelpScreen

REST_SECONDS = 0.15
WATCH_SECONDS = 2.0
_PICTURE_TOLERANCE = 12
_SMALLEST = (40, 12)


class S2RApp(GuardedApp):
    """One store, one user, one screen."""

    CSS_PATH = "app.tcss"
    TITLE = "s2r"
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        *(
            Binding(",".join(action.keys), action.name, action.description, show=False)
            for action in ACTIONS
        ),
        Binding("escape", "leave_query", "leave the query line", show=False),
    ]

    def __init__(
        self,
        session: Session,
        look: Look,
        pictures_at: Path | None = None,
        access: Access | None = None,
    ) -> None:
        """`pictures_at` is the folder that snapshots are written to (default: here, if allowed)."""
        super().__init__(ansi_color=look.mode in (ColourMode.ANSI, ColourMode.NONE))
        self.animation_level = "none"
        self.session = session
        self.look = look
        self.access = access or Access.of(session.store.path)
        self._pictures_at = pictures_at or self.access.pictures
        self._rows, self._baseline = derive.overview_rows(session.store, (session.state.run,))
        self._floor_plan: NDArray[np.uint8] | None = None
        self._pictures: plots.InstanceInput | None = None
        self._instance_heat: NDArray[np.float32] | None = None
        self._run_heat: NDArray[np.float32] | None = None
        self._run_heat_key: tuple[object, ...] = ()
        self._ticket = 0
        self._answered = 0
        self._rest: Timer | None = None
        self._wanted: tuple[object, ...] | None = None
        self.rest_seconds = REST_SECONDS

    def compose(self) -> ComposeResult:
        yield Bar("status")
        with Horizontal(id="views"):
            with Vertical(id="side"):
                yield PlotView("overview", self.look, rows=len(self.session.state.runs) + 5)
                yield PlotView("errors", self.look)
            yield PlotView("map", self.look, _PICTURE_TOLERANCE)
            yield PlotView("instance", self.look, _PICTURE_TOLERANCE)
        yield Bar("message")
        query = Input(id="query", select_on_focus=False, placeholder="worst15 & room:right")
        query.cursor_blink = False
        yield query
        yield Bar("keys")

    def on_mount(self) -> None:
        self.register_theme(textual_theme(self.look.theme))
        self.theme = textual_theme(self.look.theme).name
        self.query_one("#query", Input).can_focus = False
        self._arrange(self.size.width, self.size.height)
        self._show()
        self.call_after_refresh(self._complete)
        self.set_interval(WATCH_SECONDS, self._watch)

    def on_unmount(self) -> None:
        self.session.close()

    def on_resize(self, event: events.Resize) -> None:
        self._arrange(event.size.width, event.size.height)
        self._show()

    def _arrange(self, width: int, height: int) -> None:
        """Choose the layout for a size, as classes that the style sheet knows."""
        tiny = width < _SMALLEST[0] or height < _SMALLEST[1]
        size = "tiny" if tiny else "wide" if width >= 150 and height >= 36 else (
            "medium" if width >= 100 and height >= 30 else "narrow"
        )  # fmt: skip
        self.screen.set_classes(f"{size} view-{self.session.state.view}")
        self._layout_name = size

    # --- drawing -----------------------------------------------------------------------------

    def _show(self) -> None:
        """Draw the current state everywhere, and fetch pictures once the cursor rests."""
        state = self.session.state
        if self._layout_name == "tiny":
            wanted = f"{_SMALLEST[0]}x{_SMALLEST[1]}"
            self.query_one("#status", Bar).say(f"the terminal is too small: needs {wanted}")
            return
        self.query_one("#status", Bar).say(
            status_markup(self.session.store, state, self.size.width, self.look)
        )
        self._show_message(state)
        keys = "  ".join(
            f"[b]{_safe(key)}[/b] {word}"
            for key, word in footer(self.size.width - 2, self.access.actions)
        )
        self.query_one("#keys", Bar).say(keys)
        self._show_plots(state)
        self._fetch(state)

    def _show_message(self, state: State) -> None:
        text = state.message
        if not text and state.newest != state.generation:
            text = f"generation {state.newest} is there: g moves on to it"
        self.query_one("#message", Bar).say(_safe(text), "error" if state.is_error else "")

    def _show_plots(self, state: State) -> None:
        selected = next((i for i, row in enumerate(self._rows) if row.run == state.run), 0)
        overview = partial(_overview, self._rows, self._baseline, selected)
        self.query_one("#overview", PlotView).show(
            titled("overview", "accuracy, sim and real", overview, state)
        )
        if self._layout_name == "wide":
            columns = self.session.store.run_columns(state.run)
            view = plots.HistogramInput(
                columns.sim.error, columns.real.error, state.selected, state.base
            )
            self.query_one("#errors", PlotView).show(
                titled("errors", "position error of the selection", partial(_histogram, view), None)
            )
        view_map = derive.map_input(
            self.session.store, state, self._floor_plan, self._map_heat(state)
        )
        told = "truth coloured by shift" if state.map_mode == "colour" else "sim, truth, real"
        self.query_one("#map", PlotView).show(
            titled("map", told, partial(_map, view_map, state), state)
        )
        self._show_instance(state)

    def _show_instance(self, state: State) -> None:
        pictures = self._pictures
        view = self.query_one("#instance", PlotView)
        if state.cursor is None:
            view.show(titled("instance", "none", _blank, state))
            return
        label = f"{state.cursor}" + (f", {state.heat.label}" if state.heat else "")
        if pictures is None:
            view.show(titled("instance", f"{label}, loading", _blank, state))
            return
        if pictures.iid != state.cursor:
            label += f" (pictures of {pictures.iid})"
        view.show(titled("instance", label, partial(_instance, pictures), state))

    def _map_heat(self, state: State) -> NDArray[np.float32] | None:
        if state.overlay == "instance":
            return self._instance_heat
        if state.overlay == "run" and state.heat is not None:
            key = (state.generation, state.run, state.heat)
            if key != self._run_heat_key:
                self._run_heat_key = key
                self._run_heat = heat_source.run_grid(self.session.store, state.run, state.heat)
            return self._run_heat
        return None

    # --- pictures, read by a worker ------------------------------------------------------------

    def _fetch(self, state: State) -> None:
        """Ask for the pictures of the state after a moment of rest; the newest request wins."""
        wanted = (state.generation, state.run, state.cursor, state.heat)
        if wanted == self._wanted or state.cursor is None:
            return
        self._wanted = wanted
        self._ticket += 1
        if self._rest is not None:
            self._rest.stop()
        ask = partial(self._read_pictures, self._ticket, state)
        self._rest = self.set_timer(self.rest_seconds, ask)

    @property
    def settled(self) -> bool:
        """Whether the pictures on the screen are those of the state."""
        return self._answered == self._ticket

    @work(thread=True, exclusive=True, group="pictures")
    def _read_pictures(self, ticket: int, state: State) -> None:
        if ticket != self._ticket or state.cursor is None:
            return
        store = self.session.store
        try:
            found = derive.instance_input(store, state.run, state.cursor, state.heat)
            heat = None
            if state.heat is not None:
                heat = heat_source.instance_grid(store, state.run, state.heat, state.cursor)
        except (S2RError, OSError, ValueError) as error:
            self.post_message(PicturesReady(ticket, None, None, str(error)))
            return
        self.post_message(PicturesReady(ticket, found, heat))

    def on_pictures_ready(self, message: PicturesReady) -> None:
        if message.ticket != self._ticket:
            return
        self._answered = message.ticket
        if message.error:
            self.session.tell(message.error, is_error=True)
        self._pictures, self._instance_heat = message.instance, message.heat
        self._show()

    def _complete(self) -> None:
        """After the first paint: the other runs' figures, and the floor plan."""
        self._rows, self._baseline = derive.overview_rows(self.session.store)
        self._show()
        path = self.session.store.floor_plan_path()
        if path is not None:
            self._read_floor_plan(str(path))

    @work(thread=True, group="floor plan")
    def _read_floor_plan(self, path: str) -> None:
        try:
            self.post_message(FloorPlanReady(derive.floor_plan(path)))
        except OSError as error:
            self.log.warning(f"{path}: {error}")

    def on_floor_plan_ready(self, message: FloorPlanReady) -> None:
        self._floor_plan = message.picture
        self._show()

    def _watch(self) -> None:
        try:
            if self.session.notice():
                self._show_message(self.session.state)
        except S2RError as error:
            self.session.tell(str(error), is_error=True)
            self._show_message(self.session.state)

    # --- the query line ------------------------------------------------------------------------

    def action_edit(self) -> None:
        query = self.query_one("#query", Input)
        query.value = self.session.state.expression
        query.cursor_position = len(query.value)
        query.can_focus = True
        query.add_class("open")
        query.focus()

    def action_leave_query(self) -> None:
        query = self.query_one("#query", Input)
        query.remove_class("open")
        query.can_focus = False
        self.set_focus(None)
        if self.session.state.is_error:
            self.session.tell("")
        self._show()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        try:
            self.session.select(event.value)
        except ExpressionError as error:
            self.session.tell(str(error), is_error=True)
            event.input.cursor_position = min(error.column - 1, len(event.value))
            self._show_message(self.session.state)
            return
        self.action_leave_query()

    # --- actions -------------------------------------------------------------------------------

    def _select(self, expression: str) -> None:
        self.session.select(expression)
        self._show()

    def action_worst_real(self) -> None:
        self._select("worst15")

    def action_best_real(self) -> None:
        self._select("best15")

    def action_worst_sim(self) -> None:
        self._select("worst(15%, sim.error)")

    def action_best_sim(self) -> None:
        self._select("best(15%, sim.error)")

    def action_clear(self) -> None:
        self._select("all")

    def action_undo(self) -> None:
        self.session.undo()
        self._show()

    def action_copy(self) -> None:
        self.copy_to_clipboard(self.session.state.expression)
        self.session.tell("copied the expression")
        self._show()

    def action_next_instance(self) -> None:
        self.session.move_cursor(1)
        self._show()

    def action_previous_instance(self) -> None:
        self.session.move_cursor(-1)
        self._show()

    def action_next_run(self) -> None:
        self._change_run(1)

    def action_previous_run(self) -> None:
        self._change_run(-1)

    def _change_run(self, steps: int) -> None:
        try:
            self.session.change_run(steps)
        except S2RError as error:
            self.session.tell(str(error), is_error=True)
        self._show()

    def action_trajectory(self) -> None:
        self.session.change_trajectory()
        self._show()

    def action_next_heat(self) -> None:
        self.session.change_heat(1)
        self._show()

    def action_previous_heat(self) -> None:
        self.session.change_heat(-1)
        self._show()

    def action_mode(self) -> None:
        self.session.change_mode()
        self._show()

    def action_side(self) -> None:
        self.session.change_side()
        self._show()

    def action_overlay(self) -> None:
        self.session.change_overlay()
        self._show()

    def action_map_mode(self) -> None:
        self.session.change_map_mode()
        self._show()

    def action_zoom_in(self) -> None:
        self.session.zoom(0.6)
        self._show()

    def action_zoom_out(self) -> None:
        self.session.zoom(1 / 0.6)
        self._show()

    def action_zoom_all(self) -> None:
        self.session.zoom(0)
        self._show()

    def action_view(self, view: View) -> None:
        self.session.show(view)
        self._arrange(self.size.width, self.size.height)
        self._show()

    def action_move_on(self) -> None:
        try:
            self.session.move_on()
            self._rows, self._baseline = derive.overview_rows(self.session.store)
            self.query_one("#overview", PlotView).rows = len(self._rows) + 5
            self.query_one("#overview", PlotView).refresh(layout=True)
        except S2RError as error:
            self.session.tell(str(error), is_error=True)
        self._show()

    def action_snapshot(self) -> None:
        """Write the screen as PNG beside earlier ones."""
        from s2rtui.headless import screen_png

        number = 1
        while (target := self._pictures_at / f"s2r-{number:03d}.png").exists():
            number += 1
        try:
            target.write_bytes(screen_png(self))
        except OSError as error:
            self.session.tell(f"{target}: {error.strerror}", is_error=True)
        else:
            self.session.tell(f"wrote {target}")
        self._show()

    def action_help(self) -> None:
        self.push_screen(HelpScreen(self.access.actions))

    def action_command_palette(self) -> None:
        """The palette's frame is not ASCII; the help screen lists the same actions."""
        if self.look.ascii:
            self.action_help()
        else:
            super().action_command_palette()

    def tell_refusal(self, told: str) -> None:
        self.session.tell(told, is_error=True)
        self._show()

    async def action_quit(self) -> None:
        self.exit()

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        for action in self.access.actions:
            run = partial(self.run_action, action.name)
            yield SystemCommand(f"{action.description} ({action.key})", action.group, run)


def _safe(text: str) -> str:
    return Content(text).markup


def _overview(
    rows: list[plots.OverviewRow], baseline: float, selected: int, size: tuple[int, int], look: Look
) -> Canvas:
    return plots.overview(rows, baseline, selected, size, look)


def _histogram(view: plots.HistogramInput, size: tuple[int, int], look: Look) -> Canvas:
    return plots.histogram(view, size, look)


def _map(view: plots.GeoMapInput, state: State, size: tuple[int, int], look: Look) -> Canvas:
    return plots.geomap(view, size, look, state.viewport)


def _instance(view: plots.InstanceInput, size: tuple[int, int], look: Look) -> Canvas:
    return plots.instance(view, size, look)


def _blank(size: tuple[int, int], look: Look) -> Canvas:
    return Canvas(*size, theme=look.theme)


def run_app(path: Path, run: str | None, colour: str, ascii: bool, access: Access) -> None:
    """Open the application on a store. Raises RequestError where it cannot run."""
    from s2rtui.terminal import detect, prepare_environment

    terminal = detect(colour, ascii)
    prepare_environment(terminal)
    look = Look(mode=terminal.mode, ascii=terminal.ascii)
    app = S2RApp(Session(path, run), look, access=access)
    app.run(mouse=terminal.mode is not ColourMode.NONE)
