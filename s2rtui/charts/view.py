"""What a view is: numbers from the scene, a drawing of them, and what a brush on it means."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from s2rstore.gap_history.reader import History
from s2rstore.language.canonical_text import quoted
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.canvas.brush_surface import Mark, Panel, Point
from s2rtui.charts.shared.inputs import InstanceInput, OverviewRow
from s2rtui.session import Session, State
from s2rtui.session.provenance import (
    HeatProvenance,
    InstanceProvenance,
    heat_provenance,
    instance_provenance,
    visible_floor_key,
)
from s2rtui.user_data.notebook import Notes

Pane = Literal["overview", "centre", "tab"]
Grid = NDArray[np.float32]
Table = tuple[Sequence[str], Sequence[Sequence[object]]]
Pixels = tuple[int, int]


@dataclass(frozen=True, slots=True, eq=False)
class RunAccuracies:
    """Accuracies (N,) of every run on one side."""

    side: Side
    values: Mapping[str, NDArray[np.float32]]


@dataclass(frozen=True, slots=True, eq=False)
class Resources:
    """What workers have brought so far; a view shows what is there, under its own name.

    `grid` is the heat on the map, `seen` (rows, cols) what the selection has seen, `live` the
    instance as it is being adjusted; what each is of stands beside it. `history` holds the nights
    of the gap. `progress` and `failed` are by feed: the share that is done, and why nothing came.
    """

    rows: tuple[OverviewRow, ...] = ()
    lines: RunAccuracies | None = None
    baseline: float = math.nan
    floor_plan: NDArray[np.uint8] | None = None
    pictures: InstanceInput | None = None
    pictures_of: InstanceProvenance | None = None
    grid: Grid | None = None
    grid_of: HeatProvenance | None = None
    seen: Grid | None = None
    seen_of: tuple[object, ...] | None = None
    live: InstanceInput | None = None
    live_of: InstanceProvenance | None = None
    live_grid: Grid | None = None
    history: History | None = None
    progress: Mapping[str, float] = field(default_factory=dict)
    failed: Mapping[str, str] = field(default_factory=dict)
    saving: str = ""

    def heat_on_map(self, state: State) -> Grid | None:
        """What lies on the floor: the heat asked for, or that of the image being adjusted."""
        if state.adjusting and state.overlay == "instance":
            return self.live_grid if self.live_of == instance_provenance(state) else None
        is_present = self.grid_of and self.grid_of.name == heat_provenance(state).name
        return self.grid if is_present else None

    def heat_note(self, state: State) -> str:
        """Whose heat lies on the map, where that is not the present instance's or selection's."""
        if state.adjusting and state.overlay == "instance":
            return ""
        return self.grid_of.told(state) if self.grid_of else ""

    def seen_on_map(self, state: State) -> Grid | None:
        """The floor that the present selection has seen."""
        return self.seen if state.clip and self.seen_of == visible_floor_key(state) else None

    def adjusted(self, state: State) -> InstanceInput | None:
        """The instance that is being adjusted, as the present run's model sees it."""
        of = self.live_of
        return self.live if of and of.source == (state.generation, state.run) else None

    def asked(self, feeds: Set[str], emptied: Mapping[str, Any]) -> Resources:
        """Without what is told of feeds that are asked anew, and of the emptied fields."""
        progress = {feed: told for feed, told in self.progress.items() if feed not in feeds}
        failed = {feed: told for feed, told in self.failed.items() if feed not in feeds}
        return replace(self, **emptied, progress=progress, failed=failed)

    def fed(self, feed: str, fields: Mapping[str, Any], error: str) -> Resources:
        """With what a feed has brought, or why it could not."""
        made = self.asked({feed}, fields)
        return replace(made, failed={**made.failed, feed: error}) if error else made

    def told_of(self, words: str) -> str:
        """Words and how far each feed is."""
        shares = ", ".join(f"{feed} {share:.0%}" for feed, share in self.progress.items())
        return f"{words}  {shares}".strip()


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """All that a view draws from."""

    store: Store
    state: State
    resources: Resources
    notes: Notes = field(default_factory=Notes)

    def remark(self, iid: int) -> str:
        """The user's tags and note on an instance."""
        remark = self.notes.remarks.get(iid)
        return remark.text if remark else ""

    @property
    def caption(self) -> str:
        """What a figure's title leaves open: the data set, how many of how many, the expression."""
        counted = f"{self.state.count} instances"
        return "  ·  ".join((self.store.dataset.name, counted, self.state.expression))

    def mark(self, view: str) -> Mark | None:
        """The mark that is being drawn in a view."""
        brush = self.state.brush
        return brush.mark if brush is not None and brush.view == view else None


class View:
    """One view; a subclass says what it tells, draws and means.

    `name` is its word, `key` the key that shows it. `pane` is its place: the overview's, the
    large centre, or one that it shares with others where the screen is small. `aliases` are other
    words for it on the command line. `feeds` names what it needs from workers. `stored` tells that
    a store holds all that it shows, `one` that it shows one instance, `marked` that marks on its
    panels mean expressions; `paper` is the size of its figure where none is asked for.
    """

    name: str
    key: str
    pane: Pane = "tab"
    description: str
    aliases: tuple[str, ...] = ()
    feeds: tuple[str, ...] = ()
    stored: bool = True
    one: bool = False
    marked: bool = True
    paper: Pixels = (1600, 900)

    def told(self, scene: Scene) -> str:
        """The words beside the title."""
        return ""

    def depends(self, scene: Scene) -> tuple[object, ...] | None:
        """What the drawing depends on; equal means unchanged, None that it is always drawn."""
        return None

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        """The view in `size` (columns, rows)."""
        raise NotImplementedError

    def height(self, scene: Scene, width: int) -> int:
        """The rows that the view would like; 0 takes what there is."""
        return 0

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        """Where it can be brushed, or takes the mouse otherwise."""
        return ()

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        """Where a brush by keys begins: the cursor's place in a panel."""
        return None

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        """What a click on a panel does, at a point in data."""

    def drag(self, session: Session, scene: Scene, panel: Panel, point: Point) -> bool:
        """What dragging to a point in data does; False where it draws a mark."""
        return False

    def numbers(self, scene: Scene) -> Table:
        """What it shows as a flat table: names of columns, and rows; NaN or None for nothing."""
        raise NotImplementedError

    def words(self, scene: Scene) -> str:
        """What it shows in a sentence or two, with the numbers that matter most."""
        raise NotImplementedError

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        """The view drawn for paper. Raises RequestError where there is nothing to draw."""
        raise NotImplementedError

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        """The expression that a mark stands for."""
        raise NotImplementedError


def rounded(value: float, cell: float) -> float:
    """A number with the places that a cell of `cell` units justifies."""
    places = max(0, math.ceil(-math.log10(max(abs(cell), 1e-9))) + 1)
    return round(value, places)


def area(panel: Panel, mark: Mark, box: str, lasso: str) -> str:
    """A box or a lasso by the language's functions, in readable numbers."""
    first, second = panel.to_data(0, 0), panel.to_data(1, 1)
    wide, high = second[0] - first[0], second[1] - first[1]
    points = [(rounded(x, wide), rounded(y, high)) for x, y in mark.points]
    if mark.lasso:
        return call(lasso, [number for point in points for number in point])
    (x0, y0), (x1, y1) = points[0], points[-1]
    return call(box, [min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)])


def span(
    panel: Panel, mark: Mark, field: str, lowest: float = -math.inf, highest: float = math.inf
) -> str:
    """A range of one field, both ends included, within what the field can be."""
    cell = cell_width(panel)
    ends = sorted(
        min(max(rounded(point[0], cell), lowest), highest)
        for point in (mark.points[0], mark.points[-1])
    )
    return f"{field}:{number(ends[0])}..{number(ends[1])}"


def cell_width(panel: Panel) -> float:
    """Data units of one of the panel's own columns."""
    left = panel.x + min(1, panel.width - 1)
    return panel.to_data(left + 1, panel.y)[0] - panel.to_data(left, panel.y)[0]


def turn(mark: Mark, field: str) -> str:
    """A range of a heading in degrees, from the first end turning to the second."""
    low, high = (round(point[0]) for point in (mark.points[0], mark.points[-1]))
    if high - low >= 360:
        low, high = -180, 180
    return f"{field}:{number(_wrapped(low))}..{number(_wrapped(high))}"


def named(mark: Mark, field: str, names: Sequence[str]) -> str:
    """One or several names of a text field; those that do not exist are left out."""
    rows = sorted(round(point[1]) for point in (mark.points[0], mark.points[-1]))
    chosen = [names[row] for row in range(max(0, rows[0]), min(len(names), rows[1] + 1))]
    return " | ".join(f"{field}:{quoted(name)}" for name in chosen) or "none"


def call(function: str, numbers: Sequence[float]) -> str:
    return f"{function}({', '.join(number(value) for value in numbers)})"


def number(value: float) -> str:
    """As the language writes it."""
    return str(int(value)) if value == int(value) else f"{value:.10g}"


def _wrapped(degrees: float) -> float:
    return (degrees + 180) % 360 - 180 if abs(degrees) != 180 else degrees
