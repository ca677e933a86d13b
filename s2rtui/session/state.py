"""The frozen state that all views are drawn from."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import counted
from s2rstore.files.planned_poses import PlannedPose
from s2rstore.files.store_files import Stamp
from s2rstore.heatmap_kinds import NO_HEAT
from s2rstore.index.population import INCLUDE_HINT, Population, count_text
from s2rstore.language import Node, to_text
from s2rstore.records import Bounds, Side
from s2rstore.security.printable_text import printable
from s2rtui.canvas.marks import BrushShape
from s2rtui.user_data.notebook_schema import SavedSelection

Overlay = Literal["off", "instance", "selection", "run"]
Aggregate = Literal["mean", "max", "sum", "count"]
Operator = Literal["replace", "intersect", "union", "subtract"]

OVERLAYS: tuple[Overlay, ...] = ("off", "instance", "selection", "run")
AGGREGATES: tuple[Aggregate, ...] = ("mean", "max", "sum", "count")
MapMode = Literal["colour", "glyph", "full"]
MAP_MODES: tuple[MapMode, ...] = ("colour", "glyph", "full")
MAP_PLANE = "map"
"""The name of the plane of positions, which the map and the comparison show."""
Arrangement = Literal["beside", "blink", "slide"]
Picture = Literal["real", "sim", "difference", "heat"]
ARRANGEMENTS: tuple[Arrangement, ...] = ("beside", "blink", "slide")
PICTURES: tuple[Picture, ...] = ("real", "sim", "difference", "heat")
SIGNS: dict[Operator, str] = {"replace": "", "intersect": "&", "union": "|", "subtract": "-"}


@dataclass(frozen=True, slots=True)
class HeatChoice:
    """A heatmap kind and mode of the current run, and the side that the map shows.

    The kind `NO_HEAT` stands for plain images.
    """

    kind: str
    mode: str | None
    side: Side = "real"

    @property
    def label(self) -> str:
        if self.kind == NO_HEAT:
            return "no heatmap"
        name = self.kind.replace("_", " ")
        return f"{name} ({self.mode})" if self.mode else name


@dataclass(frozen=True, slots=True)
class ImageSettings:
    """How images are shown.

    arrangement: of both sides of an instance: beside each other, in turn with `front` in front, or
    in one image, sim left of the share `divider` of its width. picture, count: what the thumbnails
    of the sheet show, and how many there are on a page.
    """

    arrangement: Arrangement = "beside"
    front: Side = "sim"
    divider: float = 0.5
    picture: Picture = "real"
    count: int = 12


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
        """The nearest step within the slider's range."""
        steps = round((value - self.neutral) / self.step)
        return round(min(max(self.neutral + steps * self.step, self.lowest), self.highest), 6)


@dataclass(frozen=True, slots=True)
class Brush:
    """An unfinished mark in a view; `corners` counts the fixed corners of a lasso."""

    view: str
    mark: BrushShape
    corners: int = 0


@dataclass(frozen=True, slots=True)
class Adjust:
    """The adjustment sliders of a run: a value per (side, adjustment), and the active slider.

    `run_steps` are the adjustments of the run itself, in their order. `reason` says why some
    adjustments are not available; `missing` names a package that has to be installed first.
    """

    run: str
    values: tuple[tuple[tuple[Side, str], float], ...] = ()
    active: int = 0
    sliders: tuple[Slider, ...] = ()
    reason: str = ""
    missing: str = ""
    run_steps: tuple[tuple[Side, str], ...] = ()

    def value(self, key: tuple[Side, str]) -> float:
        return dict(self.values)[key]


@dataclass(frozen=True, slots=True)
class Step:
    """A step of the history: an expression at a run and trajectories (None: all), and the cursor.

    `with_trained` says whether trained instances were included. Steps that differ in the cursor
    alone are equal.
    """

    node: Node
    run: str = ""
    trajectories: tuple[str, ...] | None = None
    with_trained: bool = False
    cursor: int | None = field(default=None, compare=False)

    @property
    def expression(self) -> str:
        return to_text(self.node)


History = tuple[tuple[Step, ...], tuple[Step, ...]]
"""The steps before and after a selection, the nearest last."""


@dataclass(frozen=True, slots=True)
class Target:
    """A run, generation and trajectories (None: all) to show, and an expression to select there.

    `with_trained` includes the instances that the run's model was trained on. `node` is the
    expression, None for the present one; `loading` the expanded expression whose columns have to be
    read first. `history` is the history around it, None for the present one. `cursor` is kept if it
    is selected there. `saved` describes a shared selection where it was made.
    """

    run: str
    generation: int
    node: Node | None = None
    loading: Node | None = None
    trajectories: tuple[str, ...] | None = None
    with_trained: bool = False
    history: History | None = None
    cursor: int | None = None
    saved: SavedSelection | None = None


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """One state of the analysis.

    `node` is the selected expression. `selected` and `base` are (N,) masks: the expression's
    instances, and the base population that it was evaluated on. `chosen` (N,) are all instances of
    the expression: also those that lack an image of a side. Those are `unpaired` (N,), None without
    any, and `unpaired_text` says how many there are; views of single instances show them, no figure
    counts them. `trained` (N,) marks the instances in view that the run's model was trained on;
    they belong to `base` only if `with_trained`. `trajectories` None means all. `cursor` is an iid.
    `viewports` are the rectangles that zoomed planes show, by the name of the plane. `newest` is
    the published generation. `chosen_rows` are the names of the chosen rows of tables, by the name
    of the view. `past` and `future` hold the steps before and after this one, the nearest
    last. `operator` combines the next selection with this one. `compared_run` is the run to compare
    with. `view` receives the keys; `centre` and `tab` name the views shown in these panes.
    `pending` is the target to show once it is loaded; `keeps_message` says that the message
    outlives that. `suggested` is the expression that the message of an empty selection suggests.
    `grouping`, `group_sort` and `group_descending` belong to the rooms view, `figure` is what the
    cells of the pivot show.
    `history` is None if the store has no gap history. `fills_screen`: the active view takes the
    whole screen. `moment` is what the drives view shows, seconds since the start of the drive.
    `planned` are the poses of new images that the map shows, chosen for the run `planned_run` if
    that is known.
    """

    generation: int
    newest: int
    runs: tuple[str, ...]
    run: str
    trajectories: tuple[str, ...] | None
    node: Node
    selected: NDArray[np.bool_]
    base: NDArray[np.bool_]
    trained: NDArray[np.bool_]
    chosen: NDArray[np.bool_]
    cursor: int | None
    heat: HeatChoice | None
    with_trained: bool = False
    operator: Operator = "replace"
    brush: Brush | None = None
    lasso: bool = False
    compared_run: str | None = None
    pending: Target | None = None
    adjust: Adjust | None = None
    images: ImageSettings = ImageSettings()
    map_mode: MapMode = "colour"
    map_value: str = "shift"
    overlay: Overlay = "off"
    aggregate: Aggregate = "mean"
    dims_unseen_floor: bool = False
    room_names: bool = False
    view: str = "map"
    centre: str = "map"
    tab: str = "instance"
    sort: str = "real.error"
    descending: bool = True
    grouping: str = "room"
    group_sort: str = "real_m"
    group_descending: bool = True
    figure: str = "median"
    viewports: tuple[tuple[str, Bounds], ...] = ()
    chosen_rows: tuple[tuple[str, str], ...] = ()
    fills_screen: bool = False
    moment: float = 0.0
    history: HistoryFile | None = None
    planned: tuple[PlannedPose, ...] = ()
    planned_run: str = ""
    message: str = ""
    is_error: bool = False
    keeps_message: bool = False
    unpaired: NDArray[np.bool_] | None = None
    unpaired_text: str = ""
    suggested: Node | None = None
    past: tuple[Step, ...] = ()
    future: tuple[Step, ...] = ()

    def updated(self, **fields: Any) -> State:
        """A copy after an action; its message, if any, replaces the present one, also an error."""
        cleared = {"message": "", "is_error": False, "keeps_message": True}
        return replace(self, **{**cleared, **fields})

    def with_message(self, text: str, is_error: bool = False) -> State:
        """A copy that shows a message; an error stays until the next action."""
        return replace(self, message=printable(text), is_error=is_error, keeps_message=True)

    @property
    def count_text(self) -> str:
        """`8 of 40 (32 trained on), 9 sim only`; see `s2rstore.index.population.count_text`."""
        return count_text(
            int(np.count_nonzero(self.selected)),
            int(np.count_nonzero(self.base | self.trained)),
            int(np.count_nonzero(self.trained)),
            self.with_trained,
            self.unpaired_text,
        )

    @property
    def expression(self) -> str:
        """The canonical text of the selected expression."""
        return to_text(self.node)

    @property
    def step(self) -> Step:
        """The present selection as a step of the history."""
        return Step(self.node, self.run, self.trajectories, self.with_trained, self.cursor)

    @property
    def population(self) -> Population:
        """What the instances of `base` have in common."""
        return Population(self.trajectories, self.with_trained)

    @property
    def expressions(self) -> tuple[str, ...]:
        """The expressions of the history up to the present one."""
        return (*(step.expression for step in self.past), self.expression)

    @property
    def marked(self) -> NDArray[np.bool_] | None:
        """The (N,) trained instances that the views show and mark; None if they show none."""
        return self.trained if self.with_trained and self.trained.any() else None

    @property
    def population_message(self) -> str:
        """Whether the population holds the trained instances, for the message line."""
        count = int(np.count_nonzero(self.trained))
        if not count:
            return f"run {self.run} has no trained instances in view"
        which = f"{counted(count, 'trained instance')} in view"
        if self.with_trained:
            return f"{which} included and marked (M leaves them out)"
        return f"{which} left out ({INCLUDE_HINT})"

    def viewport_of(self, plane: str) -> Bounds | None:
        """The rectangle that a plane shows, in its coordinates; None for all of it."""
        return dict(self.viewports).get(plane)

    def chosen_row(self, view: str) -> str | None:
        """The name of the row that was chosen in a view; None without one."""
        return dict(self.chosen_rows).get(view)

    @property
    def viewport(self) -> Bounds | None:
        """The rectangle of the map in metres; None for the whole map."""
        return self.viewport_of(MAP_PLANE)

    @property
    def adjusting(self) -> bool:
        """Whether the panel for live adjustments is on the screen."""
        return self.tab == "adjust" and self.adjust is not None

    @property
    def shown_heat(self) -> HeatChoice | None:
        """The heatmap that is drawn; None without heatmaps, and where plain images are shown."""
        return None if self.heat is None or self.heat.kind == NO_HEAT else self.heat

    @property
    def side(self) -> Side:
        """The side that views of a single side show."""
        return self.heat.side if self.heat else "real"
