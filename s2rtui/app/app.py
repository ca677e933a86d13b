"""The application: keys change the session's state, and every view draws that one state."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import ClassVar

from textual import events
from textual.app import ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.driver import Driver
from textual.geometry import Size
from textual.screen import Screen

from s2rstore.errors import S2RError
from s2rstore.security.printable_text import printable_lines
from s2rtui.app import layout
from s2rtui.app.actions import ACTIONS, BY_NAME, named, offered
from s2rtui.app.call_later import later
from s2rtui.app.controllers import navigation
from s2rtui.app.controllers.brush import Brushes
from s2rtui.app.controllers.export import Papers
from s2rtui.app.controllers.load_results import LoadResultHandler
from s2rtui.app.controllers.run_save import Savings
from s2rtui.app.layout import PaneRectangle, SizeClass
from s2rtui.app.load_scheduler import LoadScheduler
from s2rtui.app.messages import LoadCompleted, LoadProgressed
from s2rtui.app.renderer import Drawing
from s2rtui.app.screens.doctor import DoctorScreen
from s2rtui.app.screens.help import HelpScreen
from s2rtui.app.screens.jump import JumpScreen
from s2rtui.app.screens.tour import TourScreen
from s2rtui.app.signals import end_on_signals
from s2rtui.app.theme import textual_theme
from s2rtui.app.widgets.bar import Bar
from s2rtui.app.widgets.panes import Panes
from s2rtui.app.widgets.plot import PlotView
from s2rtui.app.widgets.query_input import QueryInput
from s2rtui.canvas import ColourMode, RenderOptions
from s2rtui.charts.registry import BY_NAME as VIEW_BY_NAME
from s2rtui.charts.registry import VIEWS
from s2rtui.charts.scene import Resources
from s2rtui.jobs import background_thread
from s2rtui.security import Permissions
from s2rtui.session import Session, adjusting, display, shared_selection
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.image_host import ImageHost
from s2rtui.terminal.textual_compat import bounded

WATCH_SECONDS = 2.0
_FIRST_SCREEN = 0.5
"""Seconds that the first screen is waited for before anything is read."""
_PICTURE_TOLERANCE = {"map": 12, "instance": 12}


class S2RApp(Brushes, Papers, Savings):
    """One store, one user, one screen."""

    CSS_PATH = "app.tcss"
    TITLE = "s2r"
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(",".join(action.keys), action.call, action.description, show=False)
        for action in ACTIONS
    ]

    def __init__(
        self,
        session: Session,
        look: RenderOptions,
        pictures_at: Path | None = None,
        access: Permissions | None = None,
    ) -> None:
        """`pictures_at` is the folder that files are written to (default: here, if allowed)."""
        super().__init__(ansi_color=look.mode in (ColourMode.ANSI, ColourMode.NONE))
        self.animation_level = "none"
        self._wear(look)
        self.session = session
        session.waits = True
        self.look = look
        self.resources = Resources()
        self.feeding = LoadScheduler(self)
        self.arrivals = LoadResultHandler(self, self.feeding)
        self.drawing = Drawing(self)
        self.access = access or Permissions.for_store(session.store.path)
        self.files_at = pictures_at or self.access.output_dir
        self._size_class: SizeClass = "narrow"
        self._drawn_once = False
        self._sized = Size(0, 0)
        self.first_run = False
        self.terminal: Terminal | None = None
        self.wall: ImageHost | None = None

    def get_driver_class(self) -> type[Driver]:
        return bounded(super().get_driver_class())

    def compose(self) -> ComposeResult:
        yield Bar("status")
        views = [
            PlotView(view.name, self.look, _PICTURE_TOLERANCE.get(view.name, 0), self.wall)
            for view in VIEWS
        ]
        yield Panes([*views], self._places)
        yield Bar("message")
        yield QueryInput()
        yield Bar("keys")

    def _wear(self, look: RenderOptions) -> None:
        """Colours before anything is laid out: a theme set later styles every widget anew."""
        theme = textual_theme(look.theme)
        self.register_theme(theme)
        self.set_reactive(S2RApp.theme, theme.name)
        self.stylesheet.set_variables(self.get_css_variables())

    def on_mount(self) -> None:
        self._resized(self.size.width, self.size.height)
        self.refresh_views()
        self.call_after_refresh(self._feed)
        later(self, _FIRST_SCREEN, self._feed)  # a key may put another screen before the first
        self.set_interval(WATCH_SECONDS, self._watch)
        if not self.is_headless:
            end_on_signals(self.exit)
        if self.first_run:
            self.action_tour()

    def on_unmount(self) -> None:
        self.feeding.stop()
        self.leave_savings()
        background_thread.start("closing", self.session.close)
        state = self.session.state
        if self.session.notebook is not None:  # last: its file may be slow, or another's just now
            with contextlib.suppress(S2RError, OSError):
                self.session.notebook.add_history((*state.past, state.expression))

    async def on_event(self, event: events.Event) -> None:
        if isinstance(event, events.Paste):
            event.text = printable_lines(event.text)
        await super().on_event(event)

    def on_resize(self, event: events.Resize) -> None:
        if event.size != self._sized:
            self.drop_drag()
        self._resized(event.size.width, event.size.height)
        self.refresh_views()

    def _resized(self, width: int, height: int) -> None:
        self._sized = Size(width, height)
        self._size_class = layout.size_class(width, height)
        self.default_screen.set_classes(self._size_class)

    def _places(self, width: int, height: int) -> Mapping[str, PaneRectangle]:
        state = self.session.state
        rows = VIEW_BY_NAME["overview"].height(self.scene, width) + 1
        wanted = layout.LayoutRequest(state.view, state.centre, state.tab, rows)
        return layout.arrange(self._size_class, width, height, wanted)

    # --- drawing -----------------------------------------------------------------------------

    def on_panes_arranged(self) -> None:
        self.refresh_views()

    def refresh_views(self) -> None:
        if not self.drawing.possible:
            return  # an answer that comes while the screen is being taken down
        state = adjusting.follow(self.session)
        if self._size_class == "tiny":
            self.drawing.too_small()
            return
        if self._drawn_once:
            asked = self.feeding.ask(self.session.store, state)
            if asked.anew:
                self.resources = self.resources.with_requested(asked.anew, asked.emptied)
        self.query_one(Panes).place(self._wanted_places())
        self.drawing.all()

    def status_text(self) -> str:
        """The status line in plain text."""
        return "".join(self.drawing.status)

    def show_message(self) -> None:
        self.drawing.words()

    def _plot(self, name: str) -> PlotView:
        return self.query_one(f"#{name}", PlotView)

    def _wanted_places(self) -> tuple[object, ...]:
        state = self.session.state
        return (self._size_class, state.view, state.centre, state.tab, len(state.runs))

    # --- workers -----------------------------------------------------------------------------

    def _feed(self) -> None:
        """Once the first screen stands, which workers would only delay."""
        if not self._drawn_once:
            self._drawn_once = True
            self.refresh_views()

    @property
    def settled(self) -> bool:
        """Whether all that threads bring is that of the state."""
        return self._drawn_once and self.feeding.settled and not self.under_way

    def on_load_completed(self, message: LoadCompleted) -> None:
        self.arrivals.fed(message)

    def on_load_progressed(self, message: LoadProgressed) -> None:
        self.arrivals.progressed(message)

    def _watch(self) -> None:
        self.arrivals.watch()

    # --- actions -----------------------------------------------------------------------------

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Whether an action means something now."""
        begun = action == "leave" and (self.prompting or self.dragging)
        known = None if begun else named(action, parameters)
        if known is not None and not known.applies(self.session.state):
            return False
        return super().check_action(action, parameters)

    def action_do(self, name: str) -> None:
        """A change of the session, by its name in the registry."""
        change = BY_NAME[name].do
        assert change is not None
        try:
            change(self.session)
        except S2RError as error:
            self.session.tell(str(error), is_error=True)
        self.refresh_views()

    def action_view(self, name: str) -> None:
        placed = self._size_class == "wide" and self._plot(name).placed
        navigation.to(self.session, name, placed)
        self.refresh_views()

    def action_focus_next(self) -> None:
        """Textual's screens bind tab to this: here it means the next panel or view."""
        self._tab("brush_panel", "next_view")

    def action_focus_previous(self) -> None:
        self._tab("brush_panel", "previous_view")

    def _tab(self, brushing: str, otherwise: str) -> None:
        if self.screen is self.default_screen and not self.prompting:
            name = brushing if self.session.state.brush is not None else otherwise
            getattr(self, f"action_{name}")()
        else:
            self.screen.focus_next()

    def action_next_view(self) -> None:
        self.action_view(navigation.beside(self.session.state.view, 1))

    def action_previous_view(self) -> None:
        self.action_view(navigation.beside(self.session.state.view, -1))

    def action_leave(self) -> None:
        """Drop what is begun: a line of text, a brush, a pending operator."""
        if self.prompting:
            self.close_prompt()
        else:
            self.drop_drag()
            display.leave(self.session)
            self.refresh_views()

    def action_copy(self) -> None:
        self.copy_to_clipboard(shared_selection.shared_text(self.session))
        self.session.tell("copied the expression with what it was evaluated on")
        self.refresh_views()

    def action_jump(self) -> None:
        plots = [self._plot(view.name) for view in VIEWS]
        regions = [(str(p.id), p.region) for p in plots if p.placed and p.region.area]
        found = navigation.targets(regions, self.status_text(), self.session.state.expression)
        self.push_screen(JumpScreen(found), self._jumped)

    async def _jumped(self, action: str | None) -> None:
        if action:
            await self.run_action(action)

    def action_doctor(self) -> None:
        self.push_screen(DoctorScreen(self.look, self.terminal))

    def action_tour(self) -> None:
        self.push_screen(TourScreen())

    def action_help(self) -> None:
        self.push_screen(HelpScreen(self.access))

    def action_command_palette(self) -> None:
        """The palette's frame is not ASCII; the help screen lists the same actions."""
        if self.look.ascii:
            self.action_help()
        else:
            super().action_command_palette()

    async def action_quit(self) -> None:
        self.exit()

    def action_help_quit(self) -> None:
        """What ctrl+c is bound to."""
        self.session.tell(f"{BY_NAME['quit'].key} quits")
        self.show_message()

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        state = self.session.state
        for action in offered(self.access):
            if action.description and action.applies(state):
                run = partial(self.run_action, action.call)
                yield SystemCommand(f"{action.description} ({action.key})", action.group, run)
