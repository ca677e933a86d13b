"""Draws the state of an application: a line of status, the views, lines of words and keys."""

from __future__ import annotations

from s2rtui.app.actions import footer
from s2rtui.app.controllers.prompt import Prompts
from s2rtui.app.layout import SMALLEST
from s2rtui.app.status_line import StatusLine, message, shown, status_line
from s2rtui.app.widgets.bar import Bar, Piece
from s2rtui.app.widgets.plot import PlotView
from s2rtui.app.widgets.query_input import QueryInput
from s2rtui.charts.registry import VIEWS


class Drawing:
    """Draws what has changed since it was drawn last."""

    def __init__(self, app: Prompts) -> None:
        self._app = app

    @property
    def possible(self) -> bool:
        """Whether there is a screen to draw on: not while it is being taken down."""
        return bool(self._app.query("#status"))

    def all(self) -> None:
        """The whole state."""
        before, text, after = self.status
        self._bar("status").say(before, (text, "bold"), after)
        self.words()
        self._keys()
        self._views()

    def too_small(self) -> None:
        """That there is no room for views."""
        wanted = "x".join(str(number) for number in SMALLEST)
        self._bar("status").say(f"the terminal is too small: needs {wanted}")

    @property
    def status(self) -> StatusLine:
        app = self._app
        return status_line(app.session.store, app.session.state, app.size.width, app.look)

    def words(self) -> None:
        """The line of messages alone."""
        if self.possible:
            state = self._app.session.state
            text = message(state, self._app.resources)
            classes = "error" if state.is_error else "whole" if self._app.prompting else ""
            self._bar("message").say(text, classes=classes)

    def _keys(self) -> None:
        app = self._app
        pairs = footer(app.size.width - 2, app.session.state, app.access)
        if app.prompting:
            pairs = app.query_one(QueryInput).keys
        pieces: list[Piece] = []
        for key, word in pairs:
            pieces += ["  " if pieces else "", (key, "bold"), f" {word}"]
        self._bar("keys").say(*pieces)

    def _views(self) -> None:
        scene = self._app.scene
        for view in VIEWS:
            widget = self._app.query_one(f"#{view.name}", PlotView)
            if widget.placed:
                widget.show(*shown(view, scene))
            else:
                widget.clear()

    def _bar(self, name: str) -> Bar:
        return self._app.query_one(f"#{name}", Bar)
