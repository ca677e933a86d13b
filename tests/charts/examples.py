"""Small synthetic inputs of every view."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from s2rstore.findings import Finding, FindingReport
from s2rstore.findings.groups import Group, GroupErrors
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.intervals import Interval
from s2rstore.language.syntax_tree import Field, Named
from s2rstore.lazy_sequence import LazySequence
from s2rstore.records import Bounds, Room, Side
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas, RenderOptions
from s2rtui.canvas.marks import BrushShape
from s2rtui.charts.compare import CompareInput, compare_drawing
from s2rtui.charts.errors import errors_model, errors_plots
from s2rtui.charts.findings import findings_drawing
from s2rtui.charts.history import history_model, history_plots
from s2rtui.charts.map import MapInput, map_drawing
from s2rtui.charts.orientation import Name, orientation_model, orientation_plots
from s2rtui.charts.overview import overview_table
from s2rtui.charts.rooms import counts_table, groups_table, ordered, room_counts
from s2rtui.charts.scatter import scatter_drawing
from s2rtui.charts.scene import OverviewRow
from s2rtui.charts.shared.instance import InstanceInput, PoseNumbers, SideView, instance_drawing
from s2rtui.charts.suggestions import suggestions_drawing
from s2rtui.charts.umap import distance_levels, distance_range, distances, umap_extent, umap_plots
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.drawing_layout import drawing_layout
from s2rtui.drawing.floor import plane_frame
from s2rtui.drawing.plane_marks import Floor
from s2rtui.drawing.row_lines import RowLines
from s2rtui.drawing.table import Cell, Column, Row, TableSpec
from tests.drawing import examples
from tests.support import gaps
from tests.support.suggestions import suggestions_input

N = 60
BOUNDS = Bounds(0.0, 0.0, 20.0, 10.0)

ROWS = (
    OverviewRow("vanilla", Interval(0.94, 0.95, 0.96), Interval(0.75, 0.78, 0.81), 542),
    OverviewRow("dataaug", Interval(0.92, 0.93, 0.94), Interval(0.84, 0.86, 0.88), 542),
    OverviewRow("seen all", Interval.unknown(), Interval.unknown(), 0, "no unseen instance"),
)


def overview_lines(**changes: Any) -> RowLines:
    """Lines of the three runs in `ROWS`; the last run has no accuracies."""
    random = np.random.default_rng(11)
    first = np.clip(random.normal(0.8, 0.1, N), 0, 1)
    second = np.clip(first + random.normal(0.05, 0.05, N), 0, 1)
    return replace(
        RowLines(
            values=(first, second, np.full(N, np.nan)),
            selected=np.arange(N) >= 45,
            valid=np.arange(N) != 3,
            ink="real",
            cursor=50,
        ),
        **changes,
    )


def overview_drawing(lines: RowLines | None = None, brush: BrushShape | None = None) -> Drawing:
    """The rows in `ROWS`, a baseline of 0.72, and perhaps lines."""
    return Drawing(table=overview_table(ROWS, 0.72, "vanilla", lines), brush=brush)


def columns(points: Any) -> tuple[Any, Any]:
    """Points (N, 2) as columns."""
    x, y = np.asarray(points, dtype=np.float64).T.copy()
    return x, y


def map_input(bounds: Bounds = BOUNDS, **changes: Any) -> MapInput:
    """Instances on an ellipse. Positions are points (N, 2); fields of the floor are changed, too.

    The images of both sides have the true positions of the instances.
    """
    random = np.random.default_rng(7)
    along = np.linspace(0, 2 * np.pi, N, endpoint=False)
    truth = np.stack([10 + 7 * np.cos(along), 5 + 3 * np.sin(along)], axis=1)
    plan = np.zeros((50, 100, 3), dtype=np.uint8)
    plan[:, 50:] = 220
    heat = np.full((25, 50), np.nan)
    heat[5:10, 5:15] = np.linspace(0.1, 2, 50).reshape(5, 10)
    positions = {
        "truth": truth, "sim": truth + random.normal(0, 0.3, truth.shape),
        "real": truth + random.normal(0, 1.5, truth.shape),
    }  # fmt: skip
    placed = {name: changes.pop(name, points) for name, points in positions.items()}
    own = {f"{side}_truth": placed["truth"] for side in ("sim", "real")}
    placed |= {name: changes.pop(name, points) for name, points in own.items()}
    floor = {"plan": plan, "heat": heat, "heat_is_signed": False, "seen": None}
    floor = {name: changes.pop(name, value) for name, value in floor.items()}
    view = MapInput(
        **{name: columns(points) for name, points in placed.items()},
        values=np.linspace(0, 5, N),
        selected=np.arange(N) >= 45,
        valid=np.arange(N) != 3,
        floor=Floor(bounds, **floor),
        headings=along,
        sim_headings=along,
        real_headings=along,
        cursor=50,
        heat_unit="m",
        rooms=(Room("hall", 0, 0, 0, 10, 10), Room("größer", 1, 10, 0, 20, 10)),
    )
    return replace(view, **changes)


def points_of(view: MapInput | CompareInput, name: str = "truth") -> Any:
    """The positions (N, 2) of a view."""
    return np.stack(getattr(view, name), axis=1)


def draw_map(
    view: MapInput, size: Any, options: RenderOptions = DEFAULT_OPTIONS,
    viewport: Bounds | None = None, brush: BrushShape | None = None,
) -> Canvas:  # fmt: skip
    return draw_cells(map_drawing(view, viewport, brush), size, options)


def draw_compare(
    view: CompareInput, size: Any, options: RenderOptions = DEFAULT_OPTIONS,
    brush: BrushShape | None = None,
) -> Canvas:  # fmt: skip
    return draw_cells(compare_drawing(view, brush=brush), size, options)


@dataclass(frozen=True)
class MapPlace:
    """Where a map is drawn: its first column and row, and its frame."""

    x: int
    y: int
    frame: MapFrame

    def cells(self, points: Any) -> list[tuple[int, int]]:
        """Rows and columns of points (N, 2)."""
        found = np.floor(self.frame.to_cells(points)).astype(int)
        return [(row + self.y, column + self.x) for column, row in found.tolist()]


def map_place(drawing: Drawing, size: Any, options: RenderOptions = DEFAULT_OPTIONS) -> MapPlace:
    """The place of the last map of a drawing."""
    place = drawing_layout(drawing, size, options).plots[-1]
    frame = plane_frame(place.plot.x, place.plot.y, place.width, place.rows)
    return MapPlace(place.left, place.top, frame)


def compare_input(**changes: Any) -> CompareInput:
    """Two runs on the instances of `map_input`."""
    view = map_input(**{name: changes.pop(name) for name in ("truth", "plan") if name in changes})
    random = np.random.default_rng(9)
    compared = CompareInput(
        truth=view.truth,
        first=random.gamma(2, 0.5, N),
        second=random.gamma(2, 0.5, N),
        selected=view.selected,
        valid=view.valid,
        floor=Floor(BOUNDS, view.floor.plan),
        names=("vanilla", "größer"),
        cursor=50,
        rooms=view.rooms,
    )
    return replace(compared, **changes)


def side(seed: int, heat: bool = True, depth: bool = True) -> SideView:
    random = np.random.default_rng(seed)
    metres = random.uniform(0.5, 8, (32, 32)).astype(np.float32)
    metres[:4] = np.nan
    return SideView(
        rgb=random.integers(0, 256, (32, 32, 3), dtype=np.uint8),
        depth=metres if depth else None,
        heat=random.normal(0, 1, (6, 6)).astype(np.float32) if heat else None,
        pose=PoseNumbers(1.5, -2.25, 0.5, 0.75, 0.1),
    )


def instance_input(**changes: Any) -> InstanceInput:
    return replace(
        InstanceInput(
            iid=12,
            sim=side(1),
            real=side(2),
            truth=(1.0, -2.0, 0.4),
            kind="occlusion",
            mode="rgb",
            unit="m",
            signed=True,
            notes=(("room", "größer"),),
        ),
        **changes,
    )


def errors_drawing(
    cursor: int | None = None, selected: Any = None, valid: Any = None, **changes: Any
) -> Drawing:
    """Histograms of both sides in 60 bins; ten instances are selected."""
    random = np.random.default_rng(5)
    sim, real = random.gamma(2, 0.2, N), random.gamma(2, 0.8, N)
    chosen = np.arange(N) < 10 if selected is None else selected
    model = errors_model(sim, real, chosen, np.ones(N, bool) if valid is None else valid, 60)
    at: dict[Side, float] = {} if cursor is None else {"sim": sim[cursor], "real": real[cursor]}
    return Drawing(errors_plots(model, at), **changes)


def scatter_errors() -> tuple[Any, Any]:
    """Position errors of both sides."""
    random = np.random.default_rng(6)
    return random.gamma(2, 0.6, N), random.gamma(2, 0.8, N)


def scatter_of(**changes: Any) -> Drawing:
    """Half of the instances are selected; instance 3 is not valid."""
    return scatter_drawing(*scatter_errors(), np.arange(N) < 30, np.arange(N) != 3, **changes)


def umap_points() -> dict[Side, Any]:
    """Two clusters; instance 4 has no real point."""
    random = np.random.default_rng(11)
    sim = random.normal(0, 1, (N, 2)) + np.where(np.arange(N) < 30, 0, 6)[:, None]
    real = sim + random.normal(0, 1.5, (N, 2))
    real[4] = np.nan
    return {"sim": sim, "real": real}


def umap_drawing(
    points: dict[Side, Any] | None = None, cursor: int | None = 50, brush: BrushShape | None = None,
    selected: Any = None,
) -> Drawing:  # fmt: skip
    points = points or umap_points()
    planes = {side: (both[:, 0].copy(), both[:, 1].copy()) for side, both in points.items()}
    columns = (*planes["sim"], *planes["real"])
    values = distances(*columns)
    scale = distance_range(values)
    plots = umap_plots(planes, distance_levels(values, scale),
                       np.arange(N) >= 40 if selected is None else selected, np.arange(N) != 3,
                       umap_extent(*columns), cursor)  # fmt: skip
    bar = ColourBar("distance", "", scale, clipped=True)
    return Drawing(plots, notes=((bar,),), brush=brush, beside=True)


def orientation_drawing(
    cursor: dict[Name, float] | None = None, brush: BrushShape | None = None, selected: Any = None,
    valid: Any = None, y_down: bool = True,
) -> Drawing:  # fmt: skip
    """Dials of headings of which, by default, 20 of 59 are selected.

    Sim is close to the truth, real far from it; instance 4 has no real heading.
    """
    random = np.random.default_rng(12)
    truth = np.linspace(-np.pi, np.pi, N, endpoint=False)
    real = truth + random.normal(0, 0.8, N)
    real[4] = np.nan
    model = orientation_model(
        (truth + random.normal(0, 0.1, N), truth, real),
        np.arange(N) < 20 if selected is None else selected,
        np.arange(N) != 3 if valid is None else valid,
    )
    return Drawing(orientation_plots(model, cursor or {}, y_down), brush=brush, beside=True)


ROOM_NAMES = ("hall", "größer", "a very long name of a room", "kitchen", "5")


def counts_drawing(brush: BrushShape) -> Drawing:
    """Five rooms; some real predictions are in no room."""
    random = np.random.default_rng(13)
    truth = (np.arange(N) // 12).astype(np.int32)
    real = np.where(random.random(N) < 0.2, -1, random.integers(0, 5, N)).astype(np.int32)
    counts = room_counts((truth, truth, real), 5, np.arange(N) < 20, np.arange(N) != 3)
    return Drawing(table=counts_table((*ROOM_NAMES, NO_ROOM), *counts, (4, 4, 5), brush))


GROUP_COUNTS = {"hall": 12, "kitchen": 1}


def group_errors() -> tuple[GroupErrors, ...]:
    """Five rooms with errors; the last one has too few instances for an interval."""
    nan = float("nan")
    figures = ((12, 2.0, 1.0, 3.5, 0.4), (30, 5.25, 4.0, 6.0, 0.5), (9, 0.5, 0.1, 14.0, 3.0),
               (80, 104.0, 90.0, 120.0, 2.0), (2, 1.0, nan, nan, 0.9))  # fmt: skip
    return tuple(
        GroupErrors(Group(name, Named(Field("room"), name)), n, Interval(low, real, high), sim,
                    real - sim)
        for name, (n, real, low, high, sim) in zip(ROOM_NAMES, figures, strict=True)
    )  # fmt: skip


def groups_drawing(sort: str = "real_m", descending: bool = True, **changes: Any) -> Drawing:
    """The rooms of `group_errors` in their order."""
    rows = ordered(group_errors(), sort, descending, GROUP_COUNTS)
    table = groups_table(rows, "room", sort, descending, GROUP_COUNTS, "kitchen", **changes)
    return Drawing(table=table)


def list_drawing(cursor: int | None = None) -> Drawing:
    """Sixty rows in an order of their own."""
    order = np.random.default_rng(5).permutation(60).tolist()
    columns = (Column("iid", right=True, least=6), Column("error", right=True, sorts=True, least=8),
               Column("room", rank=1, least=10))  # fmt: skip
    rows = LazySequence(60, lambda place: Row(tuple(
        Cell(text) for text in (str(order[place]), f"{order[place] / 7:.2f}", f"room {place}"))
    ))  # fmt: skip
    chosen = None if cursor is None else order.index(cursor)
    return Drawing(table=TableSpec(columns, rows, "rows", chosen=chosen))


def findings_of(count: int = 4, chosen: int | None = None) -> Drawing:
    return findings_drawing(finding_report(count), chosen)


def history_drawing(nights: Any, columns: int) -> Drawing:
    return Drawing(history_plots(history_model(nights, columns), columns))


def finding_report(count: int = 4) -> FindingReport:
    """Evident findings and others, in turn."""
    found = tuple(
        Finding(
            kind=f"kind {number}",
            text=f"größer: median real error {number}.00 m (0.50 to 9.00), n {10 * number} new",
            run="vanilla",
            n=10 * number,
            evidence=f"+{number}.00 m from all others (+0.10 to +3.00 m, corrected for 7 rooms)",
            evident=number % 2 == 0,
            node=Named(Field("room"), "größer"),
        )
        for number in range(1, count + 1)
    )
    return FindingReport("vanilla", found, ("gap drift: fewer than two nights were measured",))


_BOX = BrushShape("map", ((2.0, 2.0), (9.0, 5.0)))
_LASSO = BrushShape("map", ((2.0, 2.0), (9.0, 5.0), (4.0, 8.0)), lasso=True)
_IN_UMAP = BrushShape("real", ((-9.0, -9.0), (3.0, 3.0), (4.0, 9.0)), lasso=True)
_IN_SCATTER = BrushShape("errors", ((0.5, 0.5), (9.0, 3.0), (1.0, -2.0)), lasso=True)
_BARE_SIDES = {"sim": side(1, False, False), "real": side(2, False, False), "truth": None}
_BARE_MAP = {"plan": None, "heat": None, "headings": None, "cursor": None}
DRAWINGS: dict[str, Drawing] = {
    "overview": overview_drawing(),
    "overview lines": overview_drawing(
        overview_lines(), brush=BrushShape("vanilla", ((0.6, 0.0), (0.8, 0.0)))
    ),
    "map": map_drawing(map_input()),
    "full map": map_drawing(map_input(mode="full")),
    "glyph map": map_drawing(map_input(mode="glyph", seen=np.eye(5)), brush=_BOX),
    "bare map": map_drawing(map_input(**_BARE_MAP)),
    "compare": compare_drawing(compare_input(), brush=_LASSO),
    "instance": instance_drawing(instance_input()),
    "bare instance": instance_drawing(instance_input(**_BARE_SIDES)),
    "errors": errors_drawing(5, brush=BrushShape("real", ((0.2, 3.0), (99.0, -1.0)))),
    "history": history_drawing(gaps.week(), 60),
    "umap": umap_drawing(brush=_IN_UMAP),
    "orientation": orientation_drawing(
        cursor={"sim": 30.0}, brush=BrushShape("sim", ((170.0, 1.0), (-120.0, 9.0)))
    ),
    "scatter": scatter_of(cursor=5, brush=_IN_SCATTER),
    "rooms": counts_drawing(BrushShape("truth", ((0.0, 1.0), (0.0, 9.0)))),
    "groups": groups_drawing(brush=BrushShape("groups", ((0.0, 3.0), (0.0, 4.0)))),
    "findings": findings_of(chosen=2),
    "no findings": findings_of(0),
    "suggestions": suggestions_drawing(suggestions_input()),
    "no suggestions": suggestions_drawing(suggestions_input(real=0, sim=0)),
    "list": list_drawing(7),
    "drawing": examples.drawing(),
}
"""Drawings of the views, with a brush where they have one, and some with little in them."""
