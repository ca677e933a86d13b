"""All that the views are drawn from, frozen."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.gap_history.reader import Stamp
from s2rstore.language import Node
from s2rstore.records import Bounds, Side
from s2rtui.canvas.brush import Mark
from s2rtui.user_data.notebook_schema import SavedSelection

Overlay = Literal["off", "instance", "selection", "run"]
Aggregate = Literal["mean", "max", "sum", "count"]
Operator = Literal["replace", "intersect", "union", "subtract"]

OVERLAYS: tuple[Overlay, ...] = ("off", "instance", "selection", "run")
AGGREGATES: tuple[Aggregate, ...] = ("mean", "max", "sum", "count")
MapMode = Literal["colour", "glyph", "full"]
MAP_MODES: tuple[MapMode, ...] = ("colour", "glyph", "full")
SIGNS: dict[Operator, str] = {"replace": "", "intersect": "&", "union": "|", "subtract": "-"}


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


@dataclass(frozen=True, slots=True)
class HistoryFile:
    """The history of nightly gaps; `stamp` changes whenever the file does."""

    path: Path
    stamp: Stamp


@dataclass(frozen=True, slots=True)
class Slider:
    """One adjustment of one side, as the registry of adjustments declares it."""

    side: Side
    name: str
    lowest: float
    highest: float
    neutral: float
    step: float
    unit: str

    @property
    def key(self) -> tuple[Side, str]:
        return self.side, self.name

    def clipped(self, value: float) -> float:
        """Within the slider's range, on its steps."""
        steps = round((value - self.neutral) / self.step)
        return round(min(max(self.neutral + steps * self.step, self.lowest), self.highest), 6)


@dataclass(frozen=True, slots=True)
class Brush:
    """A mark that is being drawn in a view; `corners` are those of a lasso that are fixed."""

    view: str
    mark: Mark
    corners: int = 0


@dataclass(frozen=True, slots=True)
class Adjust:
    """Sliders on a run: a value per (side, adjustment), the slider that keys move.

    `own` are the steps of the run's chains in their order. `reason` says why something cannot be
    adjusted here; `missing` what has to be installed first.
    """

    run: str
    values: tuple[tuple[tuple[Side, str], float], ...] = ()
    active: int = 0
    sliders: tuple[Slider, ...] = ()
    reason: str = ""
    missing: str = ""
    own: tuple[tuple[Side, str], ...] = ()

    def value(self, key: tuple[Side, str]) -> float:
        return dict(self.values)[key]


@dataclass(frozen=True, slots=True)
class PendingTarget:
    """Where the session is on its way to: a run, of a generation that may be newer than the present
    one, and trajectories (None: all).

    `text` is the expression to select there, empty for the present one; `node` what is evaluated
    for it, `past` and `future` what is before and after it then. `saved` are the facts that it was
    shared with.
    """

    run: str
    generation: int
    text: str = ""
    node: Node | None = None
    trajectories: tuple[str, ...] | None = None
    past: tuple[str, ...] = ()
    future: tuple[str, ...] = ()
    saved: SavedSelection | None = None


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """One state of the analysis.

    `selected` and `base` are (N,) masks: the expression's instances, and the base population that
    it was evaluated on. `trajectories` None means all in view. `cursor` is an iid. `viewport` is
    the map's world rectangle, None for all of it. `newest` is the published generation. `past`
    and `future` hold the expressions before and after this one, the nearest last. `operator`
    is how the next selection joins this one. `other` is the run that is compared with. `view` is
    the one that keys speak to, `centre` and `tab` those that share a place with others. `awaited`
    is where to turn to once what that needs is read. `history` is None where there is none.
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
    operator: Operator = "replace"
    brush: Brush | None = None
    lasso: bool = False
    other: str | None = None
    awaited: PendingTarget | None = None
    adjust: Adjust | None = None
    map_mode: MapMode = "colour"
    overlay: Overlay = "off"
    aggregate: Aggregate = "mean"
    clip: bool = False
    room_names: bool = False
    view: str = "map"
    centre: str = "map"
    tab: str = "instance"
    sort: str = "real.error"
    descending: bool = True
    viewport: Bounds | None = None
    history: HistoryFile | None = None
    message: str = ""
    is_error: bool = False
    past: tuple[str, ...] = field(default=())
    future: tuple[str, ...] = field(default=())

    @property
    def count(self) -> str:
        """`82 of 542`: selected, of the base population."""
        return f"{int(np.count_nonzero(self.selected))} of {int(np.count_nonzero(self.base))}"

    @property
    def adjusting(self) -> bool:
        """Whether the panel that adjusts live is open, in front or beside other views."""
        return self.tab == "adjust" and self.adjust is not None

    @property
    def side(self) -> Side:
        """The side that one-sided views show."""
        return self.heat.side if self.heat else "real"
