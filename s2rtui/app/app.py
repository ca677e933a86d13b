"""The Textual application: key bindings, widgets, and handlers that delegate to controllers."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import Any, ClassVar

from textual import events
from textual.app import ComposeResult, SystemCommand
from textual.binding import Binding, BindingType
from textual.color import Color
from textual.filter import LineFilter
from textual.geometry import Size
from textual.screen import Screen
from textual.theme import Theme as TextualTheme
from textual.widgets import Input

from s2rstore.errors import S2RError
from s2rstore.security.printable_text import printable_lines
from s2rtui.app.action_guard import GuardedApp
from s2rtui.app.controllers.adjust import AdjustController
from s2rtui.app.controllers.annotations import AnnotationController
from s2rtui.app.controllers.brush import BrushController
from s2rtui.app.controllers.computation import ComputationController
from s2rtui.app.controllers.export import ExportController
from s2rtui.app.controllers.hover import HoverController
from s2rtui.app.controllers.navigation import NavigationController
from s2rtui.app.controllers.player import PlayerController
from s2rtui.app.controllers.prompt import PromptController
from s2rtui.app.controllers.store_updates import CHECK_SECONDS, StoreUpdateController
from s2rtui.app.controllers.suggestions import SuggestionsController
from s2rtui.app.key_bindings import ACTIONS, BY_NAME, find_action, permitted_actions
from s2rtui.app.load_scheduler import LoadScheduler
from s2rtui.app.process_signals import end_on_signals
from s2rtui.app.screen_updater import ScreenUpdater
from s2rtui.app.screens.doctor import DoctorScreen
from s2rtui.app.screens.help import HelpScreen
from s2rtui.app.screens.tour import TourScreen
from s2rtui.app.status_line import TextBar
from s2rtui.app.widgets.panes import Panes
from s2rtui.app.widgets.plot import PlotView
from s2rtui.app.widgets.query_input import QueryInput
from s2rtui.canvas import ColourMode, RenderOptions, Rgb, Theme
from s2rtui.charts.registry import VIEWS
from s2rtui.charts.scene import LoadedData
from s2rtui.jobs import background_thread
from s2rtui.jobs.background_thread import BackgroundJobs
from s2rtui.security import Permissions
from s2rtui.session import view_settings
from s2rtui.session.session import Session
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.strips import AsciiFilter, ImageHost
from s2rtui.terminal.textual_compat import call_after

_FIRST_DRAWING_SECONDS = 0.5
"""Loading starts after the first drawing, at the latest after this time."""
_COLOUR_TOLERANCE = {"map": 12, "instance": 12, "sheet": 12}


class S2RApp(GuardedApp):
    """One user's application on one store."""

    CSS_PATH = "app.tcss"
    TITLE = "s2r"
    AUTO_FOCUS = ""
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding(action.key_names, action.call, action.description, show=False) for action in ACTIONS
    ]
    brush: BrushController
    prompt: PromptController
    annotations: AnnotationController
    export: ExportController
    computation: ComputationController
    adjust: AdjustController
    suggestions: SuggestionsController
    navigation: NavigationController
    player: PlayerController

    def __init__(
        self,
        session: Session,
        render_options: RenderOptions,
        access: Permissions | None = None,
    ) -> None:
        super().__init__(ansi_color=render_options.mode in (ColourMode.ANSI, ColourMode.NONE))
        self.animation_level = "none"
        theme = textual_theme(render_options.theme)
        self.register_theme(theme)
        # Before layout: a theme set later restyles every widget.
        self.set_reactive(S2RApp.theme, theme.name)
        self.stylesheet.set_variables(self.get_css_variables())
        self.session = session
        session.defers_loading = True
        self.render_options = render_options
        self.access = access or Permissions.for_store(session.store.path)
        self.output_folder = self.access.output_dir
        self.loaded = LoadedData(models={})
        self.jobs = BackgroundJobs(partial(self.run_on_ui, self.show_error))
        self.load_scheduler = LoadScheduler(self)
        self.brush = BrushController(self)
        self.hover = HoverController(self)
        self.prompt = PromptController(self)
        self.annotations = AnnotationController(self)
        self.export = ExportController(self)
        self.computation = ComputationController(self)
        self.adjust = AdjustController(self)
        self.suggestions = SuggestionsController(self)
        self.navigation = NavigationController(self)
        self.player = PlayerController(self)
        self.store_updates = StoreUpdateController(self)
        self.updater = ScreenUpdater(self)
        self.is_first_start = False
        self.terminal: Terminal | None = None
        self.image_host: ImageHost | None = None
        self._drawn_size = Size(0, 0)

    def compose(self) -> ComposeResult:
        yield TextBar("status")
        options = self.render_options
        views = [
            PlotView(view.name, options, _COLOUR_TOLERANCE.get(view.name, 0), self.image_host)
            for view in VIEWS
        ]
        yield Panes(views, self.updater.pane_rectangles)
        yield TextBar("message")
        yield QueryInput()
        yield TextBar("keys")

    def on_mount(self) -> None:
        self._set_size(self.size)
        self.updater.refresh()
        self.call_after_refresh(self.updater.start_loading)
        # A key may open another screen before the first drawing.
        call_after(self, _FIRST_DRAWING_SECONDS, self.updater.start_loading)
        self.set_interval(CHECK_SECONDS, self.store_updates.check_store)
        if not self.is_headless:
            end_on_signals(self.exit)
        if self.is_first_start:
            self.action_tour()

    def on_unmount(self) -> None:
        self.load_scheduler.stop()
        self.jobs.close()
        self.computation.close()
        background_thread.run_in_thread("closing", self.session.close)
        state = self.session.state
        if self.session.notebook is not None:  # last, because its file may be slow or locked
            with contextlib.suppress(S2RError, OSError):
                self.session.notebook.add_history(state.expressions)

    async def on_event(self, event: events.Event) -> None:
        if isinstance(event, events.Paste):
            event.text = printable_lines(event.text)
        await super().on_event(event)

    def on_resize(self, event: events.Resize) -> None:
        if event.size != self._drawn_size:
            self.brush.drop_drag()
        self._set_size(event.size)
        self.updater.refresh()

    def _set_size(self, size: Size) -> None:
        self._drawn_size = size
        self.default_screen.set_classes(self.updater.set_size(size))

    # --- services for the controllers --------------------------------------------------------

    @property
    def query_line(self) -> QueryInput:
        """The input line at the foot."""
        return self.query_one(QueryInput)

    def show_error(self, text: str) -> None:
        """Show an error in the message line."""
        self.session.show_message(text, is_error=True)
        self.updater.refresh()

    @contextlib.contextmanager
    def surviving_errors(self) -> Iterator[None]:
        """Show an unexpected error and return to the state before it; the application runs on."""
        store, state = self.session.store, self.session.state
        try:
            yield
        except Exception as error:
            if self.session.store is store:
                self.session.set_state(state)
            known = isinstance(error, S2RError)
            text = str(error) if known else f"internal error: {type(error).__name__}: {error}"
            self.show_error(text)

    def run_on_ui(self, function: Callable[..., object], *arguments: Any) -> None:
        """Call a function on the UI thread, from any thread; not once the application has ended."""

        def call() -> None:
            with self.surviving_errors():
                function(*arguments)

        with contextlib.suppress(RuntimeError):  # the event loop is closed
            self.call_later(call)

    def get_line_filters(self) -> list[LineFilter]:
        """Textual's filters, and ASCII output if requested."""
        ascii_filter = [AsciiFilter()] if self.render_options.ascii else []
        return [*super().get_line_filters(), *ascii_filter]

    @property
    def settled(self) -> bool:
        """Whether everything that the state needs is loaded and no job runs."""
        return self.updater.settled and not self.jobs.unfinished

    # --- messages ----------------------------------------------------------------------------

    def on_panes_arranged(self) -> None:
        self.updater.refresh()

    def on_plot_view_pressed(self, message: PlotView.Pressed) -> None:
        self.brush.on_pressed(message)

    def on_plot_view_dragged(self, message: PlotView.Dragged) -> None:
        self.brush.on_dragged(message)

    def on_plot_view_hovered(self, message: PlotView.Hovered) -> None:
        self.hover.on_hovered(message)

    def on_plot_view_wheeled(self, message: PlotView.Wheeled) -> None:
        self.navigation.on_wheeled(message)

    def on_query_input_offered(self, message: QueryInput.Offered) -> None:
        self.prompt.show_completions(message)

    def on_input_submitted(self, event: Input.Submitted) -> None:
        self.prompt.submit(event)

    # --- actions -----------------------------------------------------------------------------

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Whether an action is available now."""
        cancels = action == "leave" and (
            self.prompt.is_open or self.brush.is_dragging or self.player.is_playing
        )
        registered = None if cancels else find_action(action, parameters)
        if registered is not None and not registered.applies(self.session.state):
            return False
        return super().check_action(action, parameters)

    def action_do(self, name: str) -> None:
        """Run an action of the registry by its name, and draw the state after it."""
        action = BY_NAME[name]
        try:
            if reason := action.unavailable(self.session.store):
                self.session.show_message(reason)
            elif action.command is not None:
                action.command(self)
            elif action.do is not None:
                action.do(self.session)
        except S2RError as error:
            self.session.show_message(str(error), is_error=True)
        self.updater.refresh()

    def action_view(self, name: str) -> None:
        self.navigation.show_view(name)
        self.updater.refresh()

    def action_focus_next(self) -> None:
        """Textual binds tab to this; outside of modal screens it shows the next panel or view."""
        self._move_focus("brush_panel", "next_view")

    def action_focus_previous(self) -> None:
        self._move_focus("brush_panel", "previous_view")

    def _move_focus(self, brushing: str, otherwise: str) -> None:
        if self.screen is self.default_screen and not self.prompt.is_open:
            self.action_do(brushing if self.session.state.brush is not None else otherwise)
        else:
            self.screen.focus_next()

    def action_leave(self) -> None:
        """Cancel the input line, stop playing, or cancel the brush and the pending operator."""
        if self.prompt.is_open:
            self.prompt.cancel()
        elif self.player.is_playing:
            self.player.stop()
            self.session.show_message("playing has stopped")
            self.updater.refresh()
        else:
            self.brush.drop_drag()
            self.session.dispatch(view_settings.cancel_input)
            self.updater.refresh()

    def action_doctor(self) -> None:
        self.push_screen(DoctorScreen(self.render_options, self.terminal))

    def action_tour(self) -> None:
        self.push_screen(TourScreen())

    def action_help(self) -> None:
        self.push_screen(HelpScreen(self.access))

    def action_command_palette(self) -> None:
        """Open the palette; its frame is not ASCII, so ASCII mode opens the help instead."""
        if self.render_options.ascii:
            self.action_help()
        else:
            super().action_command_palette()

    async def action_quit(self) -> None:
        self.exit()

    def action_help_quit(self) -> None:
        """Override the action that Textual binds to ctrl+c."""
        self.session.show_message(f"{BY_NAME['quit'].key} quits")
        self.updater.refresh_message()

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        state = self.session.state
        for action in permitted_actions(self.access):
            if action.description and action.applies(state):
                run = partial(self.run_action, action.call)
                yield SystemCommand(f"{action.description} ({action.key})", action.group, run)


def textual_theme(theme: Theme) -> TextualTheme:
    """The style sheet tokens for a canvas theme."""
    return TextualTheme(
        name=f"s2r-{theme.name}",
        primary=_hex(theme.sim),
        secondary=_hex(theme.truth),
        accent=_hex(theme.truth),
        foreground=_hex(theme.text),
        background=_hex(theme.background),
        surface=_hex(theme.highlight),
        panel=_hex(theme.highlight),
        error=_hex(theme.real),
        warning=_hex(theme.truth),
        success=_hex(theme.sim),
        dark=theme.dark,
    )


def _hex(rgb: Rgb) -> str:
    return Color(*rgb).hex
