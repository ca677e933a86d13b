"""The doctor's screen: what the terminal and the machine can do, and a card to see it by."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import VerticalScroll

from s2rtui.app.screens.modal import ModalBase
from s2rtui.app.widgets.plot import PlotView
from s2rtui.canvas import RenderOptions
from s2rtui.terminal import diagnostics
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.test_card import card_height, draw_card

WIDTH = 96
"""Columns of the screen's panel, as its style says."""


class DoctorScreen(ModalBase[None]):
    """Any of the closing keys leaves it; up and down scroll."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape,q,enter,D", "dismiss", "close")]

    def __init__(self, look: RenderOptions, terminal: Terminal | None = None) -> None:
        """`terminal` is what was found when the application began."""
        super().__init__()
        self._look = look
        self._terminal = terminal

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="doctor"):
            yield PlotView("card", self._look)

    def on_mount(self) -> None:
        self.query_one("#doctor").focus()
        self.on_resize()

    def on_resize(self) -> None:
        mode, size = self._look.mode.value, self.app.size
        colours = "no" if mode == "none" else mode
        drawn = [("drawn with", f"{colours} colours, {size.width}x{size.height}")]
        rows = [*drawn, *diagnostics.terminal(self._terminal)[1:], *diagnostics.packages()]
        plot = self.query_one(PlotView)
        plot.styles.height = card_height(rows, min(self.app.size.width, WIDTH))
        plot.show(lambda size, look: draw_card(rows, size, look))
