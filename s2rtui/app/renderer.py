"""Draw the state: status line, views, message line and footer."""

from __future__ import annotations

from typing import Protocol

from textual.geometry import Size

from s2rtui.app.actions import footer
from s2rtui.app.controllers.host import ControllerHost
from s2rtui.app.controllers.prompt import PromptController
from s2rtui.app.layout import MIN_SIZE
from s2rtui.app.status_line import StatusLine, message_text, status_line
from s2rtui.app.titled_view import TitledView
from s2rtui.app.widgets.bar import Bar, Piece
from s2rtui.charts.registry import VIEWS


class RendererHost(ControllerHost, Protocol):
    """What is drawn on: the host's widgets and size."""

    @property
    def size(self) -> Size:
        """Columns and rows of the screen."""

    @property
    def bars(self) -> dict[str, Bar]:
        """The lines of text by name; empty while the screen is being closed."""


class Renderer:
    """Draws what has changed since the last drawing."""

    def __init__(self, host: RendererHost, prompt: PromptController) -> None:
        self._host, self._prompt = host, prompt

    def draw(self) -> None:
        """Draw the whole state."""
        bars = self._host.bars
        before, expression, after = self.status
        bars["status"].show(before, (expression, "bold"), after)
        self.draw_message()
        bars["keys"].show(*self._key_pieces())
        scene = self._host.scene
        for view in VIEWS:
            plot = self._host.plot(view.name)
            if plot.placed:
                plot.show(TitledView(view, scene))
            else:
                plot.clear()

    def draw_too_small(self) -> None:
        """Say that the terminal is too small for any view."""
        columns, rows = MIN_SIZE
        self._host.bars["status"].show(f"the terminal is too small: it needs {columns}x{rows}")

    @property
    def status(self) -> StatusLine:
        """The status line that fits the screen."""
        host, session = self._host, self._host.session
        return status_line(session.store, session.state, host.size.width, host.render_options)

    def draw_message(self) -> None:
        """Draw the message line alone."""
        if bar := self._host.bars.get("message"):
            state = self._host.session.state
            classes = "error" if state.is_error else "whole" if self._prompt.is_open else ""
            bar.show(message_text(state, self._host.resources), classes=classes)

    def _key_pieces(self) -> list[Piece]:
        host = self._host
        if self._prompt.is_open:
            pairs = host.query_line.keys
        else:
            pairs = footer(host.size.width - 2, host.session.state, host.access)
        pieces: list[Piece] = []
        for key, label in pairs:
            pieces += ["  " if pieces else "", (key, "bold"), f" {label}"]
        return pieces
