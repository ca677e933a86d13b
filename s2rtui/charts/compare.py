"""The comparison of two runs on one selection: where each has the smaller errors.

A run without another one is compared with its baseline, the constant prediction of the mean
position.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import ExpressionError
from s2rstore.language import evaluation, expand
from s2rstore.language.name_resolution import uses_predictions
from s2rstore.records import Bounds, Room, Side
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.canvas.fit_text import NO_BREAK, fit_text
from s2rtui.canvas.marks import mark_rows
from s2rtui.charts.mark_expressions import names_expression
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.planes import (
    PANEL,
    cursor_phrases,
    ground_marks,
    map_plot,
    place_of,
    shown_area,
    shown_rooms,
    true_columns,
    valid_cursor,
    value_range,
)
from s2rtui.charts.shared.run_changes import (
    ALL,
    EQUAL,
    NOT_EVIDENT,
    NOT_JUDGED,
    UNKNOWN,
    Change,
    Codes,
    RoomChanges,
    evidence,
    interval_text,
    room_changes,
    sentences,
    signed,
)
from s2rtui.charts.view import Pane, PointsView, Table, View
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.plane_marks import Changes, Columns, Floor, Poses, Signs
from s2rtui.drawing.plot import Ink, Mark, Phrase, Plot
from s2rtui.drawing.scale import Floats, short_number
from s2rtui.drawing.table import Cell, Column, Row, TableSpec
from s2rtui.session import run_comparison, targets
from s2rtui.session.session import Session
from s2rtui.session.view_settings import ZoomPlane, map_plane

ROWS = "rows"
"""The panel of the table of rooms."""
BASELINE = "baseline"
"""The name of the constant prediction where it takes the place of the other run."""
_COLUMNS = (Column("room", least=12), *(Column(name, right=True, rank=rank) for name, rank in (
    ("n", 2), ("A m", 1), ("B m", 1), ("change m", 0), ("95 % interval", 3), ("evident", 0),
)))  # fmt: skip
"""Columns of the table of rooms: medians of A and of B, and the median of the changes B - A."""
_WIDEST = 16
"""Most letters of a run's name in the legend."""


@dataclass(frozen=True, slots=True, eq=False)
class CompareInput:
    """Errors of two runs on one map.

    truth: x and y (N,), metres. first, second: (N,) errors of the runs `names` on `side` in `unit`,
    NaN for none. Differences are second - first: below 0 the second run is better, within `equal`
    both are equal. trajectory, room: (N,) codes, -1 for none, of rooms as indices of `room_list`;
    None without them, as in `room_changes`. trained: (N,) marks instances that the model of either
    run was trained on, None where none is shown. chosen: the highlighted row of the table.
    is_judged: False where the selection depends on predictions, as in `Change`.
    """

    truth: Columns
    first: Floats
    second: Floats
    selected: Bools
    valid: Bools
    floor: Floor
    names: tuple[str, str] = ("first", "second")
    side: Side = "real"
    unit: str = "m"
    equal: float = EQUAL
    cursor: int | None = None
    headings: Floats | None = None
    y_down: bool = True
    rooms: tuple[Room, ...] = ()
    trajectory: Codes | None = None
    room: Codes | None = None
    room_list: tuple[str, ...] = ()
    trained: Bools | None = None
    chosen: int | None = None
    is_judged: bool = True

    @property
    def changes(self) -> RoomChanges:
        """The change of the selected instances, in total and by room."""
        return room_changes(
            self.first, self.second, _members(self.selected, self.valid), self.trajectory,
            self.room, self.room_list, self.equal, self.is_judged,
        )  # fmt: skip

    @property
    def differences(self) -> NDArray[np.float64]:
        """second - first of every instance, (N,); NaN where one is unknown."""
        return _differences(self.first, self.second)

    @property
    def scale(self) -> float:
        """The difference of full colour."""
        return _full_scale(self.differences, self.valid, self.equal)

    @property
    def sentences(self) -> str:
        """The comparison in sentences."""
        return sentences(self.changes.whole, self.names, self.side, self.unit, self.equal)


def compare_drawing(
    data: CompareInput, viewport: Bounds | None = None, brush: BrushShape | None = None,
    notes: tuple[str, ...] = (),
) -> Drawing:  # fmt: skip
    """A map of the errors of each run, one of their difference, and a table of rooms."""
    first, second = (fit_text(name, _WIDEST, "…") for name in data.names)
    area = shown_area(viewport, data.floor.bounds, data.truth, data.valid)
    upper = max(value_range(errors, data.valid)[1] for errors in (data.first, data.second))
    chosen, ground = (data.selected, data.valid), _ground(data)
    plots: list[Plot] = []
    whole = data.changes.whole
    for name, errors, median in ((first, data.first, whole.first),
                                 (second, data.second, whole.second)):  # fmt: skip
        signs = Signs(*data.truth, *chosen, values=errors, scale=(0.0, upper), trained=data.trained)
        texts = [Phrase(name, "text")]
        if math.isfinite(median):
            texts.append(Phrase(f"median {short_number(median)} {data.unit}"))
        marks = (*ground, signs, *_cursor(data))
        plots.append(map_plot(marks, area, data.y_down, "", tuple(texts)))
    counts = (
        f"{whole.better} better in {second}",
        f"{whole.equal} within {short_number(data.equal)}{NO_BREAK}{data.unit}",
        f"{whole.worse} better in {first}",
    )
    changes = Changes(*data.truth, *chosen, data.differences, data.equal, data.scale, counts,
                      data.trained)  # fmt: skip
    title = (Phrase(f"{second} - {first}", "text", short="B - A"),)
    marks = (*ground, changes, *_cursor(data))
    plots.append(map_plot(marks, area, data.y_down, PANEL, title, weight=1.0))
    legend: tuple[Phrase | ColourBar, ...] = (
        ColourBar(f"{data.side} error", data.unit, (0.0, upper)),
        ColourBar(f"{second} - {first}", data.unit, (-data.scale, data.scale), ramp="changes"),
        *cursor_phrases(valid_cursor(data.cursor, data.valid)),
    )
    return Drawing(tuple(plots), _table(data), (*notes, legend), brush, beside=True)


def _ground(data: CompareInput) -> tuple[Mark, ...]:
    return ground_marks(data.floor, data.rooms, data.truth, data.selected, data.valid)


def _cursor(data: CompareInput) -> Iterator[Mark]:
    cursor = valid_cursor(data.cursor, data.valid)
    yield Poses(place_of(data.truth, data.headings, cursor), "cursor", "cursor")


def _table(data: CompareInput) -> TableSpec | None:
    """All instances, then the rooms; None where there is one room alone."""
    changes = data.changes
    if len(changes.rooms) < 2:
        return None
    rows = (_row(*room) for room in ((ALL, changes.whole), *changes.by_size))
    return TableSpec(_COLUMNS, tuple(rows), ROWS, chosen=data.chosen)


def _row(name: str, part: Change) -> Row:
    medians = (f"{error:.2f}" if math.isfinite(error) else "n/a"
               for error in (part.first, part.second))  # fmt: skip
    verdict = evidence(part)
    texts = (name, str(part.n), *medians, signed(part.change.value), interval_text(part), verdict)
    ink: Ink = "muted" if verdict in (NOT_EVIDENT, UNKNOWN, NOT_JUDGED) else "truth"
    return Row(tuple(map(Cell, texts)), bold=name == ALL, inks={len(texts) - 1: ink})


@cached_by_identity(4)
def _members(selected: Bools, valid: Bools) -> Bools:
    return np.asarray(selected & valid)


@cached_by_identity(4)
def _differences(first: Floats, second: Floats) -> NDArray[np.float64]:
    return np.asarray(second, dtype=np.float64) - first


@cached_by_identity(8)
def _full_scale(differences: Floats, valid: Bools, equal: float) -> float:
    """The 99th percentile of the absolute differences, at least twice the margin."""
    apart = np.abs(differences[valid])
    apart = apart[np.isfinite(apart)]
    largest = float(np.percentile(apart, 99)) if apart.size else 1.0
    return max(largest, 2 * equal, 1e-9)


@cached_by_identity(4)
def constant_errors(x: Floats, y: Floats, valid: Bools, trained: Bools) -> NDArray[np.float64]:
    """Errors (N,) of a constant prediction: the mean of the positions x and y (N,) that are new.

    valid: (N,) instances that the run predicted; trained: (N,) those it was trained on. All of them
    are taken where none is new.
    """
    places = np.stack([x, y], axis=1).astype(np.float64)
    new = valid & ~trained
    members = places[new if new.any() else valid]
    members = members[np.isfinite(members).all(axis=1)]
    if not members.size:
        return np.full(len(places), np.nan)
    return np.asarray(np.hypot(*(places - members.mean(axis=0)).T))


class CompareView(PointsView):
    name = "compare"
    has_rows = True
    key = "9"
    pane: Pane = "centre"
    description = "two runs, or a run and its baseline, compared on the selection"
    loads = ("floor plan",)
    figure_size = (2100, 1200)

    def subtitle(self, scene: Scene) -> str:
        other = run_comparison.other_run(scene.state)
        state = scene.state
        if other is None:
            return f"{state.side} errors of the only run and of its constant {BASELINE} (d: side)"
        text = f"{state.side} errors of {state.run} and {other} (k: other run, d: side)"
        if not targets.run_is_loaded(scene.store, other):
            return text
        return "; ".join(part for part in (text, scene.other_trained_note(other)) if part)

    def input(self, scene: Scene) -> CompareInput:
        """The errors of the current run, and of another one or of its baseline."""
        store, state = scene.store, scene.state
        other = run_comparison.other_run(state)
        first, second = _errors(scene, other)
        base = state.base if other is None else scene.common_base(other)
        marked = state.marked if other is None else scene.common_marked(other)
        return CompareInput(
            true_columns(store), first, second, state.selected, base,
            Floor(store.dataset.bounds, scene.loaded.floor_plan), (state.run, other or BASELINE),
            state.side, cursor=state.cursor, headings=store.instances.heading,
            y_down=store.dataset.y_down, rooms=shown_rooms(scene),
            trajectory=store.instances.trajectory, room=store.instances.room,
            room_list=store.instances.room_names, trained=marked,
            is_judged=_is_judged(scene),
        )  # fmt: skip

    def missing(self, scene: Scene) -> tuple[str, ...]:
        other = run_comparison.other_run(scene.state)
        return () if _is_loaded(scene, other) else (f"loading run {other}",)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        settings = scene.state.viewport, _is_judged(scene)
        return self.missing(scene) or (*super().cache_key(scene), *settings)

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        data, other = self.input(scene), run_comparison.other_run(scene.state)
        data = replace(data, chosen=self.chosen_row(scene))
        notes = (*_camera_notes(scene, other), data.sentences)
        return compare_drawing(data, scene.state.viewport, scene.mark(self.name), notes)

    def paper_drawing(self, scene: Scene) -> Drawing:
        return compare_drawing(self.input(scene), scene.state.viewport)

    def heading(self, scene: Scene) -> tuple[str, str]:
        data, other = self.input(scene), run_comparison.other_run(scene.state)
        first, second = data.names
        left_out = "" if other is None else scene.other_trained_note(other)
        texts = (data.sentences, scene.caption, left_out, *_camera_notes(scene, other))
        title = f"{data.side.capitalize()} error: {first} against {second}"
        return title, "  ·  ".join(text for text in texts if text)

    def summary(self, scene: Scene) -> str:
        other = run_comparison.other_run(scene.state)
        left_out = "" if other is None else scene.other_trained_note(other)
        return self.input(scene).sentences + (f" {left_out}." if left_out else "")

    def row_names(self, scene: Scene) -> Sequence[str]:
        """All instances, then the rooms; none where there is one room alone."""
        if self.missing(scene):
            return []
        changes = self.input(scene).changes
        return [ALL, *(name for name, _ in changes.by_size)] if len(changes.rooms) > 1 else []

    def row_expression(self, scene: Scene, row: int) -> str:
        return self._rooms(scene, BrushShape(ROWS, ((0.0, float(row)),) * 2))

    def _rooms(self, scene: Scene, mark: BrushShape) -> str:
        """The expression of the rows of the table in a mark."""
        names = self.row_names(scene)
        low, high = mark_rows(mark)
        rooms = names[max(1, low) : high + 1] if low > 0 else []
        if not rooms:
            return "all"
        points = (0.0, 0.0), (0.0, float(len(rooms)))
        return names_expression(BrushShape(ROWS, points), "room", rooms)

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        is_table = panel.name == ROWS
        (View if is_table else PointsView).click(self, session, scene, panel, point)

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        if panel.name == ROWS:
            return 0.0, float(self.chosen_row(scene) or 0)
        return super().cursor_point(scene, panel)

    def instance_at(self, scene: Scene, panel: PlotArea, cell: Point) -> int | None:
        return None if panel.name == ROWS else super().instance_at(scene, panel, cell)

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        if panel.name == ROWS:
            return self._rooms(scene, mark)
        return super().to_expression(scene, panel, mark)

    def zoom_plane(self, scene: Scene) -> ZoomPlane:
        return map_plane(scene.store, scene.state)

    def numbers(self, scene: Scene) -> Table:
        names = ("room", "n", "first_median_m", "second_median_m", "median_change_m", "low_m",
                 "high_m", "evident", "improved", "worse", "equal", "large_share", "first_mean_m",
                 "second_mean_m", "bounds")  # fmt: skip
        changes = self.input(scene).changes
        rows = [(name, *_numbers(part)) for name, part in (*changes.rooms, (ALL, changes.whole))]
        return names, rows


VIEW = CompareView()


def _errors(scene: Scene, other: str | None) -> tuple[Floats, Floats]:
    """The errors (N,) of both runs on the side that is shown, metres."""
    store, state = scene.store, scene.state
    columns = store.run_columns(state.run)
    first = columns.side(state.side).error
    if other is not None:
        return first, store.run_columns(other).side(state.side).error
    truth = true_columns(store, store.run(state.run).domain(state.side))
    return first, constant_errors(*truth, columns.valid, columns.trained)


def _is_judged(scene: Scene) -> bool:
    """Whether the selection is one that predictions did not choose."""
    try:
        words = evaluation.vocabulary(scene.store, scene.notes.nodes)
        return not uses_predictions(expand(scene.state.node, words))
    except ExpressionError:  # a saved selection in it was removed
        return False


def _is_loaded(scene: Scene, other: str | None) -> bool:
    return other is None or targets.run_is_loaded(scene.store, other)


def _camera_notes(scene: Scene, other: str | None) -> list[str]:
    """How the cameras of both runs differ, a line per side."""
    if other is None:
        return []
    return run_comparison.differences(scene.store, scene.state.run, other)


def _numbers(part: Change) -> tuple[object, ...]:
    """The numbers of a row: counts, medians and interval in metres, the run that is better.

    `bounds` is the interval as text, with `<` or `>` where few blocks do not bound it.
    """
    interval = part.change
    return (
        part.n, part.first, part.second, interval.value, *interval.bounds,
        part.better_run or evidence(part), part.better, part.worse, part.equal, part.large,
        part.first_mean, part.second_mean, interval_text(part),
    )  # fmt: skip
