"""The doctor's screen: what the terminal and the machine can do, and a card to see it by."""

from __future__ import annotations

from typing import ClassVar

from textual.app import ComposeResult
from textual.binding import BindingType
from textual.screen import ModalScreen

from s2rtui import diagnosis
from s2rtui.canvas import Look
from s2rtui.plots.testcard import card
from s2rtui.widgets.plot import PlotView


class DoctorScreen(ModalScreen[None]):
    """Any of the closing keys leaves it."""

    BINDINGS: ClassVar[list[BindingType]] = [("escape,q,enter,D", "dismiss", "close")]

    def __init__(self, look: Look) -> None:
        super().__init__()
        self._look = look

    def compose(self) -> ComposeResult:
        yield PlotView("doctor", self._look)

    def on_mount(self) -> None:
        mode, width = self._look.mode.value, f"{self.app.size.width}x{self.app.size.height}"
        drawn = [("drawn with", f"{mode} colours, {width}")]
        rows = [*drawn, *diagnosis.terminal()[1:], *diagnosis.packages()]
        self.query_one(PlotView).show(lambda size, look: card(rows, size, look))
