"""What a user does at scale, as functions of the application; and the numbers behind every view."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from s2rtui import plots
from s2rtui.app import S2RApp
from s2rtui.plots.geomap_cells import other_dots, top_levels
from s2rtui.plots.overview_lines import line_density
from s2rtui.plots.surface import Mark
from s2rtui.session import Brush, Session, comparing, listing, showing
from s2rtui.views import BY_NAME, Scene

Step = Callable[[], object]
SIZE = (200, 60)
_MAP, _TAB = (88, 54), (54, 12)


def selections(session: Session) -> list[tuple[str, Step]]:
    """Selection changes of every kind, seeded by the expressions themselves."""
    half = len(session.store.instances) // 2
    expressions = (
        "worst15",
        "best15",
        "!best15",
        "box(5, 5, 20, 15)",
        'room:"room 7"',
        'worst15 | room:"room 7"',
        "worst(30%, sim.error) & best(30%, real.error) & box(2, 2, 30, 20)",
        'all - room:"room 1"',
        "real.error > 0.8",
        "umap.real(2, 2, 6, 5)",
        "lasso(4, 4, 30, 6, 24, 20, 6, 18)",
        f"ids(0..{half})",
        "straight",
        "none",
    )

    def select(expression: str) -> Step:
        return lambda: session.select(expression)

    chosen = [(expression, select(expression)) for expression in expressions]
    return [*chosen, ("undo", session.undo), ("complement", session.complement)]


def numbers(scene: Scene) -> None:
    """What every view counts before it draws, as its drawing asks for it."""
    _overview(scene)
    view = BY_NAME["umap"].input(scene)
    frame = plots.umap_layout(view, _TAB).frame
    plots.umap_model(view, frame)
    plots.orientation_model(BY_NAME["orientation"].input(scene))
    plots.rooms_model(BY_NAME["rooms"].input(scene))
    plots.histogram_model(BY_NAME["errors"].input(scene), _TAB[0] - 12)
    shown = BY_NAME["map"].input(scene)
    model = plots.geomap_model(shown)
    frame = plots.geomap_layout(shown, _MAP).frame
    other_dots(shown.truth, model.chosen, frame)
    top_levels(shown.truth, shown.values, model.value_range, model.chosen, frame)
    other = comparing.other_run(scene.state)
    plots.difference_model(BY_NAME["compare"].input(scene, other))


def _overview(scene: Scene) -> None:
    view = BY_NAME["overview"]
    lines, rows = view.lines(scene), scene.resources.rows
    if lines is not None:
        model = plots.overview_model(rows, scene.resources.baseline, lines)
        layout = plots.overview_layout(model.rows, 0, _TAB, lines)
        line_density(lines, model.axis, layout)


def ordered(session: Session) -> Step:
    """The list's order by a column; the selection is what it was."""
    return lambda: listing.order(session.store, session.state)


def brushed(app: S2RApp, view: str, panel: str, lasso: bool = False) -> list[Step]:
    """A mark that moves over a view, a step a cell or two."""
    session = app.session

    def put(at: int) -> Step:
        x, y = 2.0 + 0.2 * at, 3.0 + 0.1 * at
        points = (
            ((x, y), (x + 4, y), (x + 4, y + 3), (x, y + 3)) if lasso else ((x, y), (x + 4, y + 3))
        )
        brush = Brush(view, Mark(panel, points, lasso))
        return lambda: session.set(replace(session.state, brush=brush))

    return [put(at) for at in range(8)]


def moves(session: Session) -> dict[str, list[Step]]:
    """Everything else that a key does, by what it is called."""
    start = lambda: session.set(replace(session.state, viewport=None))  # noqa: E731
    zooms: list[Step] = [lambda: showing.zoom(session, 1 / 0.6)] * 5
    return {
        "cursor to the next instance": [lambda: session.move_cursor(1)] * 8,
        "zoom": [*zooms, start],
        "pan": [lambda: showing.pan(session, 0.2, 0.0)] * 4 + [start],
        "map mode": [lambda: showing.change_map_mode(session)] * 3,
        "trajectory": [session.change_trajectory] * 3,
        "run seen before": [lambda: session.change_run(1), lambda: session.change_run(-1)] * 2,
    }
