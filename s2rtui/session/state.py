"""All that the views are drawn from, frozen."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds, Side

View = Literal["overview", "map", "instance"]
MapMode = Literal["colour", "full"]
Overlay = Literal["off", "instance", "run"]

VIEWS: tuple[View, ...] = ("overview", "map", "instance")
OVERLAYS: tuple[Overlay, ...] = ("off", "instance", "run")


@dataclass(frozen=True, slots=True)
class HeatChoice:
    """A heatmap kind and mode of the current run, and the side that the map shows."""

    kind: str
    mode: str | None
    side: Side = "real"

    @property
    def label(self) -> str:
        name = self.kind.replace("_", " ")
        return f"{name} ({self.mode})" if self.mode else name


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """One state of the analysis.

    `selected` and `base` are (N,) masks: the expression's instances, and the base population that
    it was evaluated on. `trajectories` None means all in view. `cursor` is an iid. `viewport` is
    the map's world rectangle, None for all of it. `newest` is the published generation. `past`
    holds earlier expressions, the latest last.
    """

    generation: int
    newest: int
    runs: tuple[str, ...]
    run: str
    trajectories: tuple[str, ...] | None
    expression: str
    selected: NDArray[np.bool_]
    base: NDArray[np.bool_]
    cursor: int | None
    heat: HeatChoice | None
    map_mode: MapMode = "colour"
    overlay: Overlay = "off"
    view: View = "map"
    viewport: Bounds | None = None
    message: str = ""
    is_error: bool = False
    past: tuple[str, ...] = field(default=())

    @property
    def count(self) -> str:
        """`82 of 542`: selected, of the base population."""
        return f"{int(self.selected.sum())} of {int(self.base.sum())}"
