"""User actions as functions of the session, and the numbers behind every view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from bench.index_store import ROOMS
from s2rtui.canvas.marks import BrushShape
from s2rtui.charts.orientation import orientation_model
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.scene import Scene
from s2rtui.drawing.plane_marks import Changes, Signs
from s2rtui.drawing.plot import Points
from s2rtui.drawing.points import Grid, change_cells, point_cells, sign_cells
from s2rtui.drawing.row_lines import layer_dots
from s2rtui.session import instance_list, navigation, selection, view_settings
from s2rtui.session.session import Session
from s2rtui.session.state import Brush, Operator

Step = Callable[[], object]
SIZE = (200, 60)
_MAP, _TAB = (88, 54), (54, 12)


def changes(session: Session, turn: int) -> list[tuple[str, Step]]:
    """Selection changes of every kind, different in every turn, so that no mask is cached."""
    half, t = len(session.store.instances) // 2, turn

    def select(expression: str) -> Step:
        return lambda: session.select(expression)

    def join(operator: Operator, expression: str) -> Step:
        def joined() -> None:
            session.dispatch(selection.set_operator, operator)
            session.select(expression)

        return joined

    chosen = {
        "worst": f"worst({13 + t}%, real.error)",
        "best": f"best({13 + t}%, real.error)",
        "room": _room(t),
        "box on the map": f"box({5 + t}, 5, {20 + t}, 15)",
        "lasso on the map": f"lasso({4 + t}, 4, 30, 6, 24, {20 - t / 2}, 6, 18)",
        "box on the embedding": f"umap.real(2, {2 + t / 4}, 6, 5)",
        "lasso on the embedding": f"umap.sim.lasso(1, {1 + t / 4}, 6, 2, 5, 5, 2, 4)",
        "headings": f"heading:{-170 + 20 * t}+-30",
        "accuracies of another run": f'run("dark").real.accuracy:{0.95 + t / 500}..0.99',
        "errors": f"real.error > {0.7 + 0.02 * t}",
        "the paper's question": f"worst({30 + t}%, sim.error) & best({30 + t}%, real.error) & "
        "box(2, 2, 30, 20)",
        "half of all": f"ids(0..{half + t})",
        "straight": f"straight & seq >= {t}",
    }
    steps = [(name, select(expression)) for name, expression in chosen.items()]
    return [
        *steps,
        ("intersection", join("intersect", _room(t + 3))),
        ("union", join("union", _room(t + 5))),
        ("complement", lambda: session.dispatch(selection.complement)),
        ("undo", lambda: session.dispatch(navigation.undo)),
    ]


def _room(index: int) -> str:
    return f'room:"{ROOMS[index % len(ROOMS)].room}"'


def numbers(scene: Scene) -> None:
    """The numbers that every view computes before it draws."""
    _overview(scene)
    orientation_model(*BY_NAME["orientation"].input(scene))
    for name in ("rooms", "errors", "umap"):
        tab = BY_NAME[name]
        if not tab.missing(scene):
            for plot in tab.drawing(scene, _TAB[0]).plots:
                for points in (mark for mark in plot.marks if isinstance(mark, Points)):
                    point_cells(points, Grid(plot.x, plot.y, _TAB[0] // 2, _TAB[1]))
    for name in ("map", "compare"):
        for plot in BY_NAME[name].drawing(scene, _MAP[0]).plots:
            grid = plot.fitted(_MAP[0], 2 * _MAP[1])
            cells = Grid(grid.x, grid.y, *_MAP)
            for mark in plot.marks:
                if isinstance(mark, Signs):
                    sign_cells(mark, cells)
                elif isinstance(mark, Changes):
                    change_cells(mark, cells)


def _overview(scene: Scene) -> None:
    table = BY_NAME["overview"].drawing(scene, _TAB[0]).table
    if table is not None and table.lines is not None:
        for layer in table.lines.layers:
            layer_dots(layer, table.columns[1].scale, _TAB[0] // 2, 1)


def moves(session: Session, turn: int) -> list[tuple[str, Step]]:
    """All other changes that keys make."""

    def mark(view: str, panel: str, lasso: bool) -> Step:
        x, y = 2.0 + 0.4 * turn, 3.0 + 0.2 * turn
        box = ((x, y), (x + 4, y + 3))
        points = (box[0], (x + 4, y), box[1], (x, y + 3)) if lasso else box
        return lambda: session.set_state(
            replace(session.state, brush=Brush(view, BrushShape(panel, points, lasso)))
        )

    def sort() -> None:
        session.dispatch(instance_list.sort_by_next_column)
        instance_list.order(session.store, session.state, session.notes)

    def plane() -> view_settings.ZoomPlane:
        return view_settings.map_plane(session.store, session.state)

    return [
        ("box moved on the map", mark("map", "map", False)),
        ("lasso moved on the map", mark("map", "map", True)),
        ("box moved on the embedding", mark("umap", "real", False)),
        ("brush left", lambda: session.dispatch(view_settings.cancel_input)),
        ("cursor to the next instance", lambda: session.dispatch(navigation.move_cursor, 1)),
        ("zoom", lambda: session.dispatch(view_settings.zoom, plane(), 1 / 0.8)),
        ("pan", lambda: session.dispatch(view_settings.pan, plane(), 0.1, 0.0)),
        ("map mode", lambda: session.dispatch(view_settings.change_map_mode)),
        ("another trajectory", lambda: session.dispatch(navigation.change_trajectory)),
        ("list by another column", sort),
        ("run seen before", lambda: session.dispatch(navigation.change_run, (-1) ** turn)),
    ]
