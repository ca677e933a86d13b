"""The suggestions view: stored answers of `s2r suggest`, and what each gains."""

from __future__ import annotations

import math
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError, sentence
from s2rstore.files.planned_poses import PlannedPose
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rstore.suggestions import AIMS, Answer, SuggestReport, read_report
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import PlotArea, Point
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pane, Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Dots, Line, Mark, Phrase, Plot, Rule, Sign
from s2rtui.drawing.scale import Scale, range_with_bounds
from s2rtui.drawing.table import Cell, Column, Dot, Row, Span, StripMark, TableSpec
from s2rtui.session import view_settings
from s2rtui.session.session import Session

MARKS = {"suggested": "*", "not evident": "?", "": " "}
_TITLES = {"real": "adapt the real images", "sim": "tune the simulator"}
_HEADS = {"real": "real images", "sim": "simulator"}
_MARGIN = 1.0
"""Space for bounds beside the gains, as a share of the range of the gains."""
_COLUMNS = (
    "for", "answer", "changes", "values", "factors", "low_m", "gain_m", "high_m", "price_m",
    "low_share", "gain_share", "high_share", "price_share", "evident", "suggested",
)  # fmt: skip
PANEL = "suggestions"
_SHOWN_POSES = 5


@dataclass(frozen=True, slots=True)
class Direction:
    """The side that is changed, and the stored report about it.

    commands: those that register the answers as runs. note: without a report, why there is none
    and the command that computes one. is_missing: whether that command can compute one.
    """

    side: Side
    aim: str
    report: SuggestReport | None = None
    commands: tuple[str, ...] = ()
    note: str = ""
    is_missing: bool = False

    @property
    def answers(self) -> tuple[Answer, ...]:
        return self.report.answers if self.report is not None else ()

    @property
    def outcome(self) -> str:
        """Why there is no suggestion; empty if there is one."""
        report = self.report
        return report.verdict if report is not None and report.best is None else self.note

    def state(self, number: int) -> str:
        """`suggested`, `not evident` or empty: what answer `number` (from 0) is."""
        if self.report is not None and self.report.best == number:
            return "suggested"
        return "" if self.answers[number].evident else "not evident"

    def mark(self, number: int) -> str:
        return MARKS[self.state(number)]


@dataclass(frozen=True, slots=True)
class SuggestionsInput:
    """Both directions of a run; `chosen` names an answer, by default the first suggested one.

    collect: the command that chooses poses of new images; empty where it is not known. planned: the
    poses that are shown, chosen for planned_run if that is known.
    """

    directions: tuple[Direction, ...]
    chosen: str | None = None
    collect: str = ""
    planned: tuple[PlannedPose, ...] = ()
    planned_run: str = ""

    @property
    def names(self) -> list[str]:
        """The names of the answers of `places`: side and number."""
        return [f"{direction.side} {number + 1}" for direction, number in self.places]

    @property
    def places(self) -> tuple[tuple[Direction, int], ...]:
        """The answers of all directions: each with its direction and its number from 0."""
        return tuple(
            (direction, number)
            for direction in self.directions
            for number in range(len(direction.answers))
        )

    @property
    def chosen_index(self) -> int | None:
        """The place of the chosen answer in `places`; None without answers."""
        names, places = self.names, self.places
        if self.chosen in names:
            return names.index(self.chosen)
        states = [direction.state(number) for direction, number in places]
        return states.index("suggested") if "suggested" in states else 0 if places else None

    @property
    def chosen_answer(self) -> tuple[Direction, int] | None:
        """Direction and number of the chosen answer; None without answers."""
        index = self.chosen_index
        return None if index is None else self.places[index]


def gain_scale(report: SuggestReport) -> Scale:
    """The axis of the gains of a report, in its unit.

    It holds 0, all gains and prices, and the bounds that are not far beyond these.
    """
    gains = [answer.gain for answer in report.answers]
    values = [0.0, *(price_of(report, answer) for answer in report.answers)]
    values += [gain.value for gain in gains if math.isfinite(gain.value)]
    bounds = (end for gain in gains for end in (gain.low, gain.high))
    return Scale(*range_with_bounds(values, bounds, _MARGIN))


def price_of(report: SuggestReport, answer: Answer) -> float:
    """The price of the changes of an answer, in the unit of its gain; 0 where unknown."""
    price = len(answer.changes) * report.price_of_a_change
    return price if math.isfinite(price) else 0.0


def evidence_text(report: SuggestReport) -> str:
    """What the answers were judged on, and the price of a change, in one sentence."""
    before = f"mean real error {report.before:.2f} m"
    price = f"{100 * report.price:g} % ({report.price_of_a_change:.2f} m)"
    if report.side == "sim":
        before, price = f"mismatch of the images {report.before:.3g}", f"{100 * report.price:g} %"
    unfinished = "" if report.complete else "; the time was used up before the search ended"
    return (
        f"{before} on {report.judged_instances} held-out instances; fitted on "
        f"{report.fitted_instances} others; price of each change {price}{unfinished}"
    )


def details(direction: Direction, number: int) -> Iterator[str]:
    """Yield lines about an answer: fitted values with intervals and truth, and the agreement."""
    answer = direction.answers[number]
    fitted = []
    for change in answer.changes:
        if change.interval is not None:
            truth = "" if change.truth is None else f", true {change.truth:g}"
            bounds = change.interval.bounds_text("{:.3g}".format, to=" .. ")
            fitted.append(f"{change.name}={change.value:g} ({bounds}){truth}")
    if fitted:
        yield "; ".join(fitted)
    made = answer.agreement
    if made is not None:
        yield (
            f"sim error {made.sim_error_before:.2f} -> {made.sim_error:.2f} m, real "
            f"{made.real_error:.2f} m; predictions closer by {made.closer.value:.2f} m "
            f"({made.closer.bounds_text(to=' .. ')}); correlation of errors "
            f"{made.correlation_before:.2f} -> {made.correlation:.2f}"
        )


def suggestions_table(data: SuggestionsInput, active: bool) -> TableSpec:
    """A row for each direction and each answer; `active`: the chosen answer is highlighted."""
    columns = (Column(""), Column(""), Column("", rank=1, scale=Scale(0.0, 1.0)))
    rows: list[Row] = []
    chosen, place = None, 0
    for direction in data.directions:
        report = direction.report
        notes = [direction.aim] if report is None else [direction.aim, evidence_text(report)]
        rows.append(
            Row((Cell(_HEADS[direction.side]), Cell(), Cell()), direction.side, True, tuple(notes))
        )
        for number in range(len(direction.answers)):
            if active and place == data.chosen_index:
                chosen = len(rows)
            rows.append(_answer_row(direction, number))
            place += 1
    return TableSpec(columns, tuple(rows), PANEL, chosen=chosen)


def _answer_row(direction: Direction, number: int) -> Row:
    report, answer = direction.report, direction.answers[number]
    assert report is not None
    count = len(answer.changes)
    name = f"{direction.mark(number)}{number + 1}  {count} change{'s' if count > 1 else ''}"
    scale, gain = gain_scale(report), answer.gain

    def at(value: float) -> float:
        return float(scale.fraction(value))

    strip: list[StripMark] = [
        Span(at(gain.low), at(gain.high), direction.side), Dot(at(0.0), "muted", "vertical"),
        Dot(at(price_of(report, answer)), "text", "baseline"),
        Dot(at(gain.value), direction.side, "selected" if answer.evident else "trained"),
    ]  # fmt: skip
    cells = Cell(name), Cell(report.gain_interval(gain)), Cell(strip=tuple(strip))
    values = f"{answer.changes_text} ({', '.join(answer.factors)})"
    return Row(cells, "text", answer.evident, (f"    {values}",))


def gain_plot(report: SuggestReport) -> Plot:
    """Gains against the number of changes: on held-out instances, on those of the fit; prices."""
    factor, unit = (1.0, "m") if report.side == "real" else (100.0, "%")
    counts = np.array([float(len(answer.changes)) for answer in report.answers])
    most = float(counts.max(initial=1.0))
    fitted = factor * np.array([0.0, *(answer.fitted for answer in report.answers)])
    scale = gain_scale(report)
    ends = [factor * scale.low, factor * scale.high, *fitted.tolist()]
    margin = 0.08 * (max(ends) - min(ends))
    price = factor * report.price_of_a_change
    x = np.array([0.0, most + 0.5])
    marks: list[Mark] = [
        Rule(0.0, "y"), Line(x, price * x, "text", dashed=True),
        Line(np.array([0.0, *counts]), fitted, "muted", dashed=True),
    ]  # fmt: skip
    signs: tuple[tuple[bool, Sign], ...] = ((True, "selected"), (False, "trained"))
    for is_evident, sign in signs:
        held = [answer for answer in report.answers if answer.evident == is_evident]
        at = np.array([float(len(answer.changes)) for answer in held])
        gains = [answer.gain.scaled(factor) for answer in held]
        marks.append(Dots.of(at, gains, report.side, sign=sign))
    ticks = tuple((float(number), str(number)) for number in range(int(most) + 1))
    title = _TITLES[report.side] + ("" if report.answers else ": nothing helps")
    return Plot(
        Scale(-0.2, most + 0.5, ("number of changes (no unit)",), fixed=ticks),
        Scale(min(ends) - margin, max(ends) + margin, (f"gain ({unit})",)), tuple(marks),
        title=(Phrase(title, report.side),),
    )  # fmt: skip


LEGEND = (
    "* suggested, ? not shown to help (its interval holds 0); dot: gain on held-out instances with "
    "its interval, empty where not shown to help; line: 0; dashes: price of the changes"
)


def paper_drawing(directions: Sequence[Direction]) -> Drawing:
    """The drawing on paper: a plot for each direction that has a report, and its answers."""
    reports = [direction.report for direction in directions if direction.report is not None]
    best = [
        line
        for direction in directions
        if direction.report is not None and direction.report.best is not None
        for line in details(direction, direction.report.best)
    ]
    legend = f"{LEGEND} and gain on the instances of the fit"
    table = suggestions_table(SuggestionsInput(tuple(directions)), active=False)
    missing = [f"{_TITLES[each.side]}: {each.note}" for each in directions if each.note]
    return Drawing(tuple(map(gain_plot, reports)), table, (*best, *missing, legend))


class SuggestionsView(View):
    name = "suggestions"
    has_rows = True
    key = "J"
    pane: Pane = "centre"
    description = "stored answers of s2r suggest: what would help, and how much"
    title = "what would help"
    brushable = False
    counts_instances = False
    figure_size = (1600, 1300)

    def subtitle(self, scene: Scene) -> str:
        has_answers = self.input(scene).chosen_index is not None
        return f"changes that would help{' (enter: apply)' if has_answers else ''}"

    def input(self, scene: Scene) -> SuggestionsInput:
        state = scene.state
        store, run = scene.store, state.run
        collect = shlex.join(
            ["s2r", "collect", str(store.path), "--run", run, "--out", "poses.csv"]
        )
        return SuggestionsInput(
            _directions(store, run), state.chosen_row(self.name), collect, state.planned,
            state.planned_run,
        )  # fmt: skip

    def missing_sides(self, scene: Scene) -> tuple[Side, ...]:
        """The directions whose search can be run and is not stored."""
        directions = _directions(scene.store, scene.state.run)
        return tuple(direction.side for direction in directions if direction.is_missing)

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        return suggestions_drawing(self.input(scene), scene.state.view == self.name)

    def paper_drawing(self, scene: Scene) -> Drawing:
        directions = self.input(scene).directions
        if all(direction.report is None for direction in directions):
            notes = "; ".join(direction.note for direction in directions)
            raise RequestError(f"--view {self.name}: {notes}")
        return paper_drawing(directions)

    def heading(self, scene: Scene) -> tuple[str, str]:
        return f"{scene.state.run}: {self.title}", scene.store.dataset.name

    def row_names(self, scene: Scene) -> Sequence[str]:
        return self.input(scene).names

    def first_choice(self, scene: Scene) -> int:
        return self.input(scene).chosen_index or 0

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        """Choose the answer of a row; it is not applied."""
        data = self.input(scene)
        if (place := answer_of_row(data, round(point[1]))) is not None:
            session.dispatch(view_settings.choose_row, self.name, data.names[place])

    def numbers(self, scene: Scene) -> Table:
        return _COLUMNS, [_row(direction, number) for direction, number in self.input(scene).places]

    def summary(self, scene: Scene) -> str:
        parts = [
            f"{sentence(direction.aim)}: "
            f"{direction.note or (direction.report and direction.report.verdict)}."
            for direction in self.input(scene).directions
        ]
        return f"{scene.state.run}. {' '.join(parts)}"


def suggestions_drawing(data: SuggestionsInput, active: bool = True) -> Drawing:
    """The answers, and how the chosen one is applied."""
    notes = [f"{_TITLES[each.side]}: {each.outcome}" for each in data.directions if each.outcome]
    if data.planned:
        notes += _planned_lines(data.planned, data.planned_run)
    if data.collect:
        notes.append(f"collect images: `{data.collect}` chooses poses for the map")
    if (chosen := data.chosen_answer) is not None:
        direction, number = chosen
        how = "enter adjusts the real images live; there S saves them as a run"
        if direction.side == "sim":
            how = "enter copies the command"
        notes += [f"answer {number + 1}: {how}", *details(*chosen), direction.commands[number],
                  LEGEND]  # fmt: skip
    return Drawing(table=suggestions_table(data, active), notes=tuple(notes))


def _planned_lines(planned: Sequence[PlannedPose], run: str) -> Iterator[str]:
    """The number of poses in each room, and the first poses with their reasons."""
    rooms = Counter(pose.room or "outside all rooms" for pose in planned)
    of = f" for run {run}" if run else ""
    yield f"{len(planned)} poses of new images{of}, on the map: " + ", ".join(
        f"{room} {count}" for room, count in rooms.most_common()
    )
    for pose in planned[:_SHOWN_POSES]:
        gain = "" if math.isnan(pose.expected_gain_m) else f", gain {pose.expected_gain_m:.3f} m"
        yield (
            f"  {pose.x_m:g} {pose.y_m:g} m, {pose.heading_deg:g} degrees, "
            f"{pose.room or 'no room'}{gain}: {pose.reason or 'no reason given'}"
        )


def search_arguments(store: Path, run: str, side: Side) -> list[str]:
    """The arguments of s2r that search the answers of a run for one side."""
    return ["suggest", str(store.absolute()), "--run", run, "--for", side]


def answer_of_row(data: SuggestionsInput, row: int) -> int | None:
    """The place of the answer in a row of the table; None for the row of a direction."""
    rows: list[int | None] = []
    for direction in data.directions:
        first = sum(place is not None for place in rows)
        rows += [None, *range(first, first + len(direction.answers))]
    return rows[row] if 0 <= row < len(rows) else None


@cached_by_identity(4)
def _directions(store: Store, run: str) -> tuple[Direction, ...]:
    return tuple(_direction(store, run, side) for side in reversed(SIDES))


def _direction(store: Store, run: str, side: Side) -> Direction:
    record = store.run(run)
    try:
        record.network("suggest")
        report = read_report(store, run, side)
    except RequestError as error:
        return Direction(side, AIMS[side], note=str(error))
    if report is None:
        command = shlex.join(["s2r", "suggest", str(store.path), "--run", run, "--for", side])
        note = f"no stored result; `{command}` computes one"
        return Direction(side, AIMS[side], note=note, is_missing=True)
    commands = [answer.command(str(store.path), record, side) for answer in report.answers]
    return Direction(side, AIMS[side], report, tuple(commands))


def _row(direction: Direction, number: int) -> tuple[object, ...]:
    report, answer = direction.report, direction.answers[number]
    assert report is not None
    price = len(answer.changes) * report.price_of_a_change
    figures = (answer.gain.low, answer.gain.value, answer.gain.high, price)
    unknown = (None,) * len(figures)
    both = (*figures, *unknown) if direction.side == "real" else (*unknown, *figures)
    return (
        direction.side, number + 1, len(answer.changes), answer.changes_text,
        ", ".join(answer.factors), *both, "yes" if answer.evident else "no",
        "yes" if report.best == number else "no",
    )  # fmt: skip


VIEW = SuggestionsView()
