"""The doctor screen: what the terminal and the machine support, and a test card."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import VerticalScroll

from s2rtui.app.screens import ModalBase
from s2rtui.app.widgets.plot import PlotView
from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.terminal import diagnostics
from s2rtui.terminal.capabilities import Terminal
from s2rtui.terminal.test_card import card_height, draw_card

WIDTH = 96
"""Columns of the panel, as in the style sheet."""


@dataclass(frozen=True, slots=True)
class TestCard:
    """The diagnostics and the test card, as a plot widget draws them."""

    rows: list[tuple[str, str]]
    cache_key: None = None

    def draw(self, size: tuple[int, int], options: RenderOptions) -> Canvas:
        """Draw in `size` (columns, rows)."""
        return draw_card(self.rows, size, options)


class DoctorScreen(ModalBase[None]):
    """Shows the diagnostics; up and down scroll."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape,q,enter,D", "dismiss", "close")]

    def __init__(self, options: RenderOptions, terminal: Terminal | None = None) -> None:
        """`terminal` holds the capabilities detected at the start."""
        super().__init__()
        self._options = options
        self._terminal = terminal

    def compose(self) -> ComposeResult:
        with VerticalScroll(id="doctor"):
            yield PlotView("card", self._options)

    def on_mount(self) -> None:
        self.query_one("#doctor").focus()
        self.on_resize()

    def on_resize(self) -> None:
        mode, size = self._options.mode.value, self.app.size
        colours = "no" if mode == "none" else mode
        drawn = [("drawn with", f"{colours} colours, {size.width}x{size.height}")]
        rows = [*drawn, *diagnostics.terminal(self._terminal)[1:], *diagnostics.packages()]
        plot = self.query_one(PlotView)
        plot.styles.height = card_height(rows, min(self.app.size.width, WIDTH))
        plot.show(TestCard(rows))
