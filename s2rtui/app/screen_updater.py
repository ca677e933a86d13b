"""Draw the state: status line, views, message line and footer; request the data it needs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from textual.geometry import Region, Size

from s2rstore.reader import Store
from s2rtui.app import layout
from s2rtui.app.key_bindings import footer
from s2rtui.app.layout import MIN_SIZE, SizeClass
from s2rtui.app.status_line import Piece, TextBar, message_text, part_columns, status_line
from s2rtui.app.titled_view import TitledView
from s2rtui.app.widgets.panes import Panes
from s2rtui.app.widgets.plot import PlotView
from s2rtui.canvas import RenderOptions
from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.charts.scene import Scene
from s2rtui.session.state import State

if TYPE_CHECKING:
    from s2rtui.app.app import S2RApp


class ScreenUpdater:
    """Draws what has changed since the last drawing."""

    def __init__(self, app: S2RApp) -> None:
        self._app = app
        self._size_class: SizeClass = "narrow"
        self._is_loading_started = False

    def set_size(self, size: Size) -> SizeClass:
        """Set the size of the screen; returns its class."""
        self._size_class = layout.size_class(size.width, size.height)
        return self._size_class

    @property
    def shows_one_view(self) -> bool:
        """Whether the screen is too small for several views."""
        return self._size_class in ("tiny", "narrow")

    def start_loading(self) -> None:
        """Start background loading, which would delay the first drawing."""
        if not self._is_loading_started:
            self._is_loading_started = True
            self.refresh()

    @property
    def settled(self) -> bool:
        """Whether everything that the state needs is loaded."""
        return self._is_loading_started and self._app.load_scheduler.settled

    def refresh(self) -> None:
        """Draw the state and request the data it needs."""
        app, state = self._app, self._app.session.state
        bars = {str(bar.id): bar for bar in app.query(TextBar)}
        if not bars:
            return  # the screen is being closed
        if self._size_class == "tiny":
            columns, rows = MIN_SIZE
            bars["status"].show(f"the terminal is too small: it needs {columns}x{rows}")
            return
        if self._is_loading_started:
            restarted, cleared = app.load_scheduler.request(app.session.store, state)
            if restarted:
                app.loaded = app.loaded.with_requested(restarted, cleared)
        panes = app.query_one(Panes)
        panes.place(self.pane_rectangles(*panes.available_size))
        before, expression, after = status_line(*self._status)
        bars["status"].show(before, (expression, "bold"), after)
        self.refresh_message()
        bars["keys"].show(*self._key_pieces())
        scene = self.scene
        for view in VIEWS:
            plot = self.plot(view.name)
            if plot.placed:
                plot.show(TitledView(view, scene))
            else:
                plot.clear()

    def refresh_message(self) -> None:
        """Draw the message line alone."""
        for bar in self._app.query("#message").results(TextBar):
            state = self._app.session.state
            hover = self._app.hover
            is_whole = self._app.prompt.is_open or (state.message and not hover.text)
            classes = "error" if state.is_error else "whole" if is_whole else ""
            text = message_text(state, self._app.loaded, hover.text, hover.cursor_text)
            bar.show(text, classes=classes)

    @property
    def scene(self) -> Scene:
        """The present input of all views."""
        session = self._app.session
        return Scene(session.store, session.state, self._app.loaded, session.notes)

    def plot(self, view: str) -> PlotView:
        """The widget of a view."""
        return self._app.query_one(f"#{view}", PlotView)

    def title_rows(self, view: str) -> int:
        """The rows of the title of a view on the screen."""
        titled = TitledView(BY_NAME[view], self.scene)
        width, height = self.plot(view).size
        return len(titled.title((width, height), self._app.render_options))

    def is_placed(self, view: str) -> bool:
        """Whether the wide layout shows a view."""
        return self._size_class == "wide" and self.plot(view).placed

    def visible_regions(self) -> list[tuple[str, Region]]:
        """Name and screen region of every view on the screen."""
        plots = [self.plot(view.name) for view in VIEWS]
        return [(str(plot.id), plot.region) for plot in plots if plot.placed and plot.region.area]

    def pane_rectangles(self, width: int, height: int) -> Mapping[str, Region]:
        """The layout of the views in `width` x `height` cells."""
        state = self._app.session.state
        scene, options, available = self.scene, self._app.render_options, height

        def rows(view: str, columns: int) -> int:
            least = BY_NAME[view].height(scene, columns)
            if not least:
                return 0
            high = max(least, available)
            return least + len(TitledView(BY_NAME[view], scene).title((columns, high), options))

        request = layout.LayoutRequest(
            state.view, state.centre, state.tab, rows("overview", width),
            state.view if state.fills_screen else "", max(1, len(state.runs) - 1), rows,
        )  # fmt: skip
        size = self._size_class
        if size == "wide" and self._app.session.store.missing_run:
            size = "medium"  # most views of the stacked column show nothing
        return layout.arrange(size, width, height, request)

    def status_text(self) -> str:
        """The status line in plain text."""
        return "".join(status_line(*self._status))

    def status_columns(self) -> dict[str, int]:
        """The columns of the screen where the parts of the status line begin."""
        padding = self._app.query_one("#status", TextBar).styles.padding.left
        return {part: padding + at for part, at in part_columns(*self._status).items()}

    @property
    def _status(self) -> tuple[Store, State, int, RenderOptions]:
        """What the status line is made from."""
        app, session = self._app, self._app.session
        return session.store, session.state, app.size.width, app.render_options

    def _key_pieces(self) -> list[Piece]:
        app = self._app
        if app.prompt.is_open:
            pairs = app.query_line.keys
        else:
            pairs = footer(app.size.width - 2, app.session.state, app.access)
        pieces: list[Piece] = []
        for key, label in pairs:
            pieces += ["  " if pieces else "", (key, "bold"), f" {label}"]
        return pieces
