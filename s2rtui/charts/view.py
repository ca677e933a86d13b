"""The base class of all views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.index.catalog import NO_POSES
from s2rstore.reader import Store
from s2rstore.records import Side
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity, identity_key
from s2rtui.canvas import BrushShape, Canvas, PlotArea, Point, RenderOptions, Size, Theme
from s2rtui.charts.mark_expressions import area_expression
from s2rtui.charts.scene import Scene, model_source
from s2rtui.charts.shared.planes import known_point, nearest_iid, true_positions
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.drawing_layout import drawing_layout
from s2rtui.drawing.figures import NUMBERS, Figures, figure_choices, figure_rows, figure_table
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.scale import Floats
from s2rtui.drawing.table import TableSpec
from s2rtui.session import navigation, view_settings
from s2rtui.session.session import Session
from s2rtui.session.state import State
from s2rtui.session.view_settings import ZoomPlane

Pane = Literal["overview", "centre", "tab"]
Table = tuple[Sequence[str], Sequence[Sequence[object]]]
Pixels = tuple[int, int]
_REACH = 1.5
"""Largest distance in cells between the mouse and an instance under it."""


class View:
    """One view of a scene, whose `Drawing` is drawn in cells, in true pixels, on paper, as text.

    Class attributes:
        name: the view's name in commands, options and titles.
        key: the key that shows it.
        pane: its place on the screen: the overview's, the large centre, or a tab.
        description: a phrase for `--help` and the help screen.
        about: a phrase beside its title on the screen.
        title: what its figure shows, after the name of the run; by default the description.
        aliases: other names on the command line.
        loads: names of the background loads that deliver its data.
        from_store: whether a store holds everything that it shows.
        single_instance: whether it shows the cursor's instance alone.
        brushable: whether marks on its panels stand for expressions.
        figure_size: default size of its figure, pixels.
        paper_columns: the columns of a plot on paper, where its marks depend on them, as bars do;
            and of a dial.
        counts_instances: whether its numbers are those of the selected instances.
        needs_poses: whether it shows nothing of a data set without poses.
        needs_run: whether it shows nothing of a store without a computed run.
        has_rows: whether keys choose rows of its table, which enter selects.
    """

    name: str
    key: str
    pane: Pane = "tab"
    description: str
    title: str = ""
    about: str = ""
    aliases: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    from_store: bool = True
    single_instance: bool = False
    brushable: bool = True
    figure_size: Pixels = (1600, 900)
    paper_columns: int = 60
    counts_instances: bool = True
    needs_poses: bool = True
    needs_run: bool = True
    has_rows: bool = False

    def unavailable(self, store: Store) -> str:
        """Why the view has nothing to show of a store, in one line; empty if it has."""
        if self.needs_poses and not store.has_poses:
            return NO_POSES
        return store.missing_run if self.needs_run and store.has_poses else ""

    def require_available(self, store: Store) -> None:
        """Raise RequestError where the view has nothing to show of a store."""
        if reason := self.unavailable(store):
            if reason == NO_POSES:
                raise RequestError(f"{store.path}: {reason}, so there is no {self.name} view")
            raise RequestError(f"{store.path}: {self.name}: {reason}")

    def subtitle(self, scene: Scene) -> str:
        """The text beside the title, by default `about`."""
        return self.about

    def loading(self, scene: Scene) -> str:
        """What is being loaded for the view while it shows something older; empty if nothing is.

        The title names it after the subtitle without becoming longer, so that the drawing below
        keeps its size.
        """
        return ""

    def waiting(self, scene: Scene) -> str:
        """What a process is computing while the view has nothing to show; empty otherwise."""
        computing = scene.loaded.computing
        return f"{computing}; the view fills in" if computing and self.missing(scene) else ""

    def input(self, scene: Scene) -> Any:
        """The arrays and numbers that are drawn; None where they are the loaded data alone."""
        return None

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        """Everything that the drawing depends on: by default the input, the run, the selection,
        the cursor, the view's mark, viewport and chosen row, and what could not be loaded.
        """
        state, name = scene.state, self.name
        arrays = identity_key((self.input(scene), state.selected, state.base, state.marked))
        failed = tuple([scene.loaded.failed.get(load) for load in (*self.loads, name)])
        row = state.chosen_row(name), state.view == name
        shown = state.cursor, scene.mark(name), state.viewport_of(name)
        return state.generation, state.run, arrays, failed, *row, *shown

    def missing(self, scene: Scene) -> tuple[str, ...]:
        """Lines that say why there is nothing to draw; empty if there is."""
        return ()

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        """The plots, the table and the notes, for plots that are `columns` cells wide."""
        raise NotImplementedError

    def paper_drawing(self, scene: Scene) -> Drawing:
        """The drawing of its figure."""
        return self.drawing(scene, self.paper_columns)

    def _sized(self, scene: Scene, size: Size, options: RenderOptions) -> Drawing:
        """The drawing for cells, whose layout says how many columns the plots have."""
        if reasons := self.missing(scene):
            waits = self.waiting(scene)
            return Drawing(notes=(*reasons, waits) if waits else reasons)
        drawing = self.drawing(scene, self.paper_columns)
        places = drawing_layout(drawing, size, options).plots
        if not places or places[0].plot.turns or places[0].width == self.paper_columns:
            return drawing
        return self.drawing(scene, places[0].width)

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        """Draw the view in `size` (columns, rows)."""
        return draw_cells(self._sized(scene, size, options), size, options)

    def height(self, scene: Scene, width: int) -> int:
        """The preferred number of rows; 0 takes all that are free."""
        return 0

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[PlotArea]:
        """The parts that take the mouse or a brush."""
        return drawing_panels(self._sized(scene, size, options), size, options)

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        """The cursor's place in a panel, where a brush drawn with keys begins."""
        return None

    def row_names(self, scene: Scene) -> Sequence[str]:
        """Names of the rows of its table that can be chosen, in their order; by default none."""
        return ()

    def row_width(self, scene: Scene) -> int:
        """How many of `row_names` are beside each other; the rows of a table of cells."""
        return 1

    def first_choice(self, scene: Scene) -> int:
        """The place of the row that is chosen until the user chooses one."""
        return 0

    def chosen_row(self, scene: Scene) -> int | None:
        """The place of the chosen row; None in a view that is not active and has none chosen."""
        names, name = self.row_names(scene), scene.state.chosen_row(self.name)
        if name in names:
            return names.index(name)
        return self.first_choice(scene) if names and scene.state.view == self.name else None

    def row_expression(self, scene: Scene, row: int) -> str:
        """The expression that selects the instances of a row; empty where it stands for none."""
        raise NotImplementedError

    def select_row(self, session: Session, scene: Scene, row: int) -> None:
        """Select the instances of a row that can be chosen, and choose it."""
        name, expression = self.row_names(scene)[row], self.row_expression(scene, row)
        session.dispatch(view_settings.choose_row, self.name, name)
        if not expression:
            session.show_message(f"the row {name} stands for no instances")
            return
        state = session.select(expression)
        if not state.message:
            session.show_message(f"selected {state.expression}: {state.count_text}")

    def play(self, session: Session, scene: Scene, steps: int) -> bool:
        """Go on by steps, to the next instances; False if there is none."""
        before = session.state.cursor
        session.dispatch(navigation.play_on)
        return session.state.cursor != before

    def zoom_plane(self, scene: Scene) -> ZoomPlane | None:
        """The plane that zoom and pan keys move; None where the view has none."""
        return None

    def plane_point(self, scene: Scene, point: Point) -> Point:
        """A point of a panel in the coordinates of the zoom plane; by default the same."""
        return point

    def instance_at(self, scene: Scene, panel: PlotArea, cell: Point) -> int | None:
        """The iid that is drawn at a cell of a panel (column, row; the middle is at + 0.5)."""
        return None

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        """Handle a click on a panel at a point in data coordinates: select the row of a table."""
        if 0 <= (row := round(point[1])) < len(self.row_names(scene)):
            self.select_row(session, scene, row)

    def drag(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> bool:
        """Handle dragging to a point in data coordinates; False lets it draw a mark."""
        return False

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        """The expression that selects what a mark covers."""
        raise NotImplementedError

    def numbers(self, scene: Scene) -> Table:
        """The figures of the view as a table: column names and rows; None and NaN are empty.

        Names of columns of metres end in `_m`, of degrees in `_deg`.
        """
        raise NotImplementedError

    def heading(self, scene: Scene) -> tuple[str, str]:
        """The title of its figure and its text, and the subtitle of the figure."""
        return f"{scene.title}: {self.title or self.description}", scene.caption

    def summary(self, scene: Scene) -> str:
        """One or two sentences with the most important figures."""
        title, _ = self.heading(scene)
        reasons = self.missing(scene)
        text = ". ".join(reasons) or self.drawing(scene, self.paper_columns).text
        return f"{title}. {text}."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        """Draw the view on paper. Raises RequestError where there is nothing to draw."""
        from s2rtui.drawing.paper import draw_paper

        if reasons := self.missing(scene):
            raise RequestError(f"--view {self.name}: {'; '.join(reasons)}")
        return draw_paper(self.paper_drawing(scene), size, theme, *self.heading(scene))


class StatisticsView(View):
    """A view of numbers with intervals: `model` computes them, `figures` and `plots` show them.

    The application computes the numbers in the background, and shows those of the selection before
    until they are there.
    """

    brushable = False
    has_rows = True

    def model(self, store: Store, state: State) -> Any:
        """Compute the numbers of a state; a text where there are none. Pure, and may be slow."""
        raise NotImplementedError

    def members(self, state: State) -> Bools | None:
        """The selected instances (N,); None for all, those that are not localised included."""
        return None if np.array_equal(state.selected, state.base) else state.selected

    def figures(self, model: Any) -> Figures:
        """The numbers that the table on the screen and `s2r show` print, by side."""
        raise NotImplementedError

    def plots(self, model: Any) -> tuple[Plot, ...]:
        """The plots above the table."""
        return ()

    def table(self, model: Any) -> TableSpec:
        """The table; by default the figures of both sides beside each other."""
        return figure_table(self.figures(model))

    def notes(self, model: Any) -> tuple[str, ...]:
        """Lines below the table."""
        return ()

    def choices(self, model: Any, side: Side) -> Sequence[tuple[str, str]]:
        """Names of the rows, and the expressions that select their instances on a side.

        By default those of the figures; an expression is empty where a row stands for none.
        """
        return figure_choices(self.figures(model), side)

    def row_names(self, scene: Scene) -> Sequence[str]:
        return [name for name, _ in self._choices(scene)]

    def row_expression(self, scene: Scene, row: int) -> str:
        return self._choices(scene)[row][1]

    def _choices(self, scene: Scene) -> Sequence[tuple[str, str]]:
        model = self.input(scene)
        if model is None or isinstance(model, str):
            return ()
        return self.choices(model, scene.state.side)

    def missing(self, scene: Scene) -> tuple[str, ...]:
        model = self.input(scene)
        if isinstance(model, str):
            return (model,)
        message = scene.loaded.failed.get(self.name, "figures are being computed")
        return (message,) if model is None else ()

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        model = self.input(scene)
        table = replace(self.table(model), panel=self.name, chosen=self.chosen_row(scene))
        return Drawing(self.plots(model), table, self.notes(model))

    def numbers(self, scene: Scene) -> Table:
        model = self.input(scene)
        return NUMBERS, [] if isinstance(model, str) else list(figure_rows(self.figures(model)))

    def input(self, scene: Scene) -> Any:
        """The numbers; in the application None until the first ones of a run are computed."""
        state, models = scene.state, scene.loaded.models
        if models is None:
            return _computed(self, scene.store, _Source(model_source(state), state))
        loaded = models.get(self.name)
        return loaded.model if loaded is not None and loaded.is_of(state) else None

    def loading(self, scene: Scene) -> str:
        loaded = (scene.loaded.models or {}).get(self.name)
        is_older = loaded is not None and loaded.source != model_source(scene.state)
        return "figures of the selection" if is_older else ""


@dataclass(frozen=True, slots=True)
class _Source:
    """A state; states from which the same numbers are computed are equal."""

    key: tuple[object, ...]
    state: State = field(compare=False)


@cached_by_identity(8)
def _computed(view: StatisticsView, store: Store, source: _Source) -> Any:
    return view.model(store, source.state)


class PointsView(View):
    """A view whose panels show each instance as a point in a plane: a click goes to the nearest."""

    def points(self, scene: Scene, panel: PlotArea) -> Floats:
        """(N, 2) points of a panel, by default the true positions."""
        return true_positions(scene.store)

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        return known_point(self.points(scene, panel), scene.state.cursor)

    def nearest(self, scene: Scene, panel: PlotArea, point: Point) -> int | None:
        """The iid of the base population that is drawn the nearest to a point of a panel."""
        return nearest_iid(self.points(scene, panel), scene.state.base, point)

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        nearest = self.nearest(scene, panel, point)
        if nearest is not None:
            session.set_cursor(nearest)

    def instance_at(self, scene: Scene, panel: PlotArea, cell: Point) -> int | None:
        """The nearest instance of the base population, if it lies on the cell or beside it."""
        nearest = self.nearest(scene, panel, panel.to_data(*cell))
        if nearest is None:
            return None
        column, row = panel.to_cells(*self.points(scene, panel)[nearest])
        return nearest if max(abs(column - cell[0]), abs(row - cell[1])) <= _REACH else None

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        return area_expression(panel, mark, "box", "lasso")
