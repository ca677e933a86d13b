"""View `doors`: how many instances are selected, as one dot."""

from __future__ import annotations

import numpy as np

from s2rstore.intervals import Interval
from s2rstore.reader import Store
from s2rtui.charts.view import StatisticsView
from s2rtui.drawing.figures import Figure, Figures
from s2rtui.drawing.plot import Dots, Plot
from s2rtui.drawing.scale import Scale
from s2rtui.session.state import State


class Doors(StatisticsView):
    """The model is the number of selected instances."""

    name = "doors"
    key = "~"
    description = "doors of the rooms"
    title = "doors"

    def model(self, store: Store, state: State) -> int:
        return int(state.selected.sum())

    def figures(self, model: int) -> Figures:
        return {"real": (Figure("doors", Interval.unknown(2.0), digits=0, n=model),)}

    def plots(self, model: int) -> tuple[Plot, ...]:
        dots = Dots(np.array([1.0]), np.array([2.0]), "real")
        return (Plot(Scale(0, 2, ("room",)), Scale(0, 4, ("doors",)), (dots,)),)


VIEW = Doors()
