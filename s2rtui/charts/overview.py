"""The overview: the accuracies of every run, and of every instance as a line across the runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import islice

import numpy as np

from s2rstore.intervals import Interval
from s2rstore.language.canonical_text import string
from s2rstore.metrics import run_metrics
from s2rstore.metrics.recall import headline
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity, identity_key
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.canvas.marks import mark_range
from s2rtui.charts.mark_expressions import range_expression
from s2rtui.charts.scene import OverviewRow, Scene, TranslatorGain, TranslatorRow
from s2rtui.charts.shared.planes import SIDE_PHRASES, cursor_phrases
from s2rtui.charts.view import Pane, Table, View
from s2rtui.drawing.drawing import Drawing, Note
from s2rtui.drawing.plot import Ink, Phrase, Rule
from s2rtui.drawing.row_lines import BAND_TEXT, RowLines
from s2rtui.drawing.scale import Floats, Scale, tick_step
from s2rtui.drawing.table import Cell, Column, Dot, Row, Span, StripMark, TableSpec, Text
from s2rtui.session.session import Session

MOST_READ = 1000
"""Most translators, and most gains, that are read from a store."""
_GAINS = (
    "SELECT translator, run, value, low, high, metric = 'trained_error_gain' "
    "FROM translator_metric WHERE metric IN ('error_gain', 'trained_error_gain') "
    "AND reference = 'translator' AND value IS NOT NULL "
    f"ORDER BY metric, translator, run LIMIT {MOST_READ}"
)
ROWS_PER_RUN = 3
"""Preferred number of rows per run, the lines to the next run included."""
FRAME_ROWS = 3
"""Rows of the header, the axis and the legend."""
MOST_TRANSLATORS = 5
SHORTEST_STRIP = 17
"""Cells of a strip that the numbers of the cursor's instance leave."""
NUMBERS = (
    "run", "sim median_m", "sim heading_deg", "sim recall", "real median_m", "real heading_deg",
    "real recall", "not localised", "sim accuracy", "sim low", "sim high", "real accuracy",
    "real low", "real high", "n", "independent", "baseline", "note",
)  # fmt: skip


def overview_rows(
    store: Store, runs: Sequence[str] | None = None
) -> tuple[list[OverviewRow], float]:
    """A row per computed run, or per run in `runs`, and the baseline of the first run.

    Accuracies leave out the instances that the model was trained on.
    """
    rows = []
    for name in runs or [name for name, run in store.runs.items() if run.key]:
        sim, real = (run_metrics.side_metrics(store, name, side) for side in ("sim", "real"))
        note = real.accuracy.no_bounds if real.n else "the model was trained on every instance"
        headlines = headline(store, name, "sim"), headline(store, name, "real")
        rows.append(OverviewRow(name, sim.accuracy, real.accuracy, real.n, note, headlines))
    return rows, run_metrics.baseline_accuracy(store, rows[0].run) if rows else math.nan


def accuracy_scale(
    rows: Sequence[OverviewRow], baseline: float, lines: RowLines | None, names: tuple[str, ...]
) -> Scale:
    """The scale of accuracies that holds all rows and the baseline, rounded outwards in 0 .. 1.

    With lines it holds the 1st percentile of the valid instances of every run, and 1.
    """
    numbers = [baseline]
    for accuracy in (side for row in rows for side in (row.sim, row.real)):
        numbers += [accuracy.value, *(accuracy.bounds if accuracy.is_known else ())]
    if lines is not None:
        numbers += [1.0, *_lowest(lines.values, lines.valid)]
    known = [value for value in numbers if math.isfinite(value)] or [0.0, 1.0]
    step = tick_step(max(max(known) - min(known), 0.02), 4)
    low = max(0.0, round(math.floor(min(known) / step + 1e-9) * step, 9))
    high = max(low + step, round(math.ceil(max(known) / step - 1e-9) * step, 9))
    return Scale(low, min(max(1.0, low + step), high), names, percent=True)


@cached_by_identity(8)
def _lowest(columns: tuple[Floats, ...], valid: Bools) -> list[float]:
    """The 1st percentile of the valid known accuracies of each run."""
    known = (column[valid & np.isfinite(column)] for column in columns)
    return [float(np.percentile(column, 1)) for column in known if column.size]


def translator_rows(store: Store) -> tuple[TranslatorRow, ...]:
    """A row per translator with its gains, in the order of the store."""
    gains: dict[str, list[TranslatorGain]] = {}
    for name, run, value, low, high, trained in store.execute(_GAINS):
        interval = None if low is None or high is None else (low, high)
        gain = TranslatorGain(str(run), float(value), interval, bool(trained))
        gains.setdefault(name, []).append(gain)
    return tuple(
        TranslatorRow(name, record.direction, record.accepted, tuple(gains.get(name, ())))
        for name, record in islice(store.translators.items(), MOST_READ)
    )


def ordered(rows: Sequence[TranslatorRow], run: str) -> list[TranslatorRow]:
    """Accepted translators first, then those with the largest gain on a run."""

    def rank(row: TranslatorRow) -> tuple[bool, float]:
        gains = [gain.value for gain in row.gains if gain.run == run and not gain.trained]
        return row.accepted is not True, -max(gains, default=-math.inf)

    return sorted(rows, key=rank)


def overview_table(
    rows: Sequence[OverviewRow], baseline: float, run: str, lines: RowLines | None = None,
    on_paper: bool = False, chosen: str | None = None,
) -> TableSpec:  # fmt: skip
    """A row per run: both accuracies on a common scale with the baseline, and in percent.

    chosen: the run whose row is highlighted, by default `run`.

    On paper there are columns of the gap and of the number of instances, too.
    """
    rules = (Rule(baseline, ink="truth", dashed=True),) if math.isfinite(baseline) else ()
    scale = accuracy_scale(rows, baseline, lines, ("accuracy (%)", "%") if on_paper else ("",))
    name = "" if on_paper else "accuracy %"
    strip = Column(name, scale=scale, rules=rules, least=SHORTEST_STRIP - on_paper)
    columns = [Column("run"), strip, Column("sim", "sim", True, rank=1),
               Column("real", "real", True)]  # fmt: skip
    if on_paper:
        columns += [Column("gap", right=True, rank=3), Column("n", right=True, rank=4)]
    if lines is not None and lines.cursor is not None:
        columns.append(Column(str(lines.cursor), "cursor", True, rank=2))
    made = tuple(
        _row(row, math.nan if lines is None else lines.at_cursor(place), columns, row.run == run)
        for place, row in enumerate(rows)
    )
    place = next((place for place, row in enumerate(rows) if row.run == (chosen or run)), None)
    return TableSpec(tuple(columns), made, chosen=place, lines=lines)


def _row(row: OverviewRow, cursor: float, columns: Sequence[Column], bold: bool) -> Row:
    gap = row.sim.value - row.real.value
    texts = {"sim": _percent(row.sim.value), "real": _percent(row.real.value),
             "gap": _percent(gap), "n": f"{row.n}"}  # fmt: skip
    cells = [Cell(row.run), Cell(strip=_strip(row, cursor))]
    cells += [Cell(texts.get(column.name, _percent(cursor))) for column in columns[2:]]
    inks: dict[int, Ink] = {
        place: "muted" if cells[place].text == "n/a" else column.ink
        for place, column in enumerate(columns) if place > 1
    }  # fmt: skip
    return Row(tuple(cells), bold=bold, inks=inks, name=row.run)


def _strip(row: OverviewRow, cursor: float) -> tuple[StripMark, ...]:
    """Both accuracies with their intervals, the gap between them, and that of an instance."""
    sim, real = row.sim, row.real
    marks: list[StripMark] = [
        Span(*side.bounds, ink)
        for side, ink in ((sim, SIDES[0]), (real, SIDES[1])) if side.is_known
    ]  # fmt: skip
    if math.isnan(sim.value) and math.isnan(real.value):
        return (*marks, Text(row.note or "n/a"))
    low, high = sorted((sim.value, real.value))
    marks.append(Span(low, high, "muted" if real.value < sim.value else "truth", is_thick=True))
    return (*marks, Dot(cursor, "cursor", "cursor"), Dot(sim.value, "sim", "sim"),
            Dot(real.value, "real", "real"))  # fmt: skip


def translator_notes(rows: Sequence[TranslatorRow], run: str) -> tuple[Note, ...]:
    """Translators of the store: their verdicts, and their gains on a run."""
    shown = ordered(rows, run)[:MOST_TRANSLATORS]
    more = f", {len(shown)} of {len(rows)}" if len(shown) < len(rows) else ""
    notes: list[Note] = [(Phrase(f"translators, gains on {run}{more}"),)] if shown else []
    for row in shown:
        name = Phrase(row.translator, "sim" if row.direction == "sim2real" else "real")
        verdict = Phrase(row.verdict, "text" if row.accepted else "muted")
        notes.append((name, verdict, Phrase(row.gain_text(run), "text")))
    return tuple(notes)


class OverviewView(View):
    name = "overview"
    key = "1"
    pane: Pane = "overview"
    description = "runs: median errors, recall and accuracy in simulation and in reality"
    loads = ("rows", "lines")

    def subtitle(self, scene: Scene) -> str:
        lines = scene.loaded.accuracies(scene.state)
        if failed := scene.loaded.failed.get("rows" if not scene.loaded.rows else "lines"):
            return f"accuracy, sim and real: {failed}"
        if lines is None:
            return "accuracy, sim and real"
        found = self.lines(scene)
        drawn = f" bands: {BAND_TEXT}" if found and found.is_banded else ""
        pale = ", pale: trained on" if lines.trained is not None else ""
        row = next((row for row in self._rows(scene) if row.run == scene.state.run), None)
        lead = row.headlines[SIDES.index(lines.side)].short if row else ""
        return f"{lines.side} {lead and f'{lead}; '}accuracy{drawn}{pale}"

    def lines(self, scene: Scene) -> RowLines | None:
        """The instances as lines across the runs, once they are loaded."""
        rows, state = self._rows(scene), scene.state
        lines = scene.loaded.accuracies(state)
        if lines is None or any(row.run not in lines.values for row in rows):
            return None
        values = tuple(lines.values[row.run] for row in rows)
        return RowLines(values, state.selected, state.base, lines.side, lines.trained, state.cursor)

    def _rows(self, scene: Scene) -> tuple[OverviewRow, ...]:
        """A row per run; only names until the accuracies are loaded."""
        note = "cannot be read" if "rows" in scene.loaded.failed else "loading"
        unknown = Interval.unknown()
        empty = (OverviewRow(run, unknown, unknown, note=note) for run in scene.state.runs)
        return scene.loaded.rows or tuple(empty)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        loaded, lines = scene.loaded, identity_key(self.lines(scene))
        values = self._rows(scene), loaded.baseline, loaded.translators, lines
        return *super().cache_key(scene), *values

    def row_names(self, scene: Scene) -> Sequence[str]:
        return [row.run for row in self._rows(scene)]

    def first_choice(self, scene: Scene) -> int:
        return scene.state.runs.index(scene.state.run)

    def missing(self, scene: Scene) -> tuple[str, ...]:
        return () if self._rows(scene) else ("no run has been computed",)

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        loaded, run, lines = scene.loaded, scene.state.run, self.lines(scene)
        chosen = scene.state.chosen_row(self.name)
        table = overview_table(self._rows(scene), loaded.baseline, run, lines, chosen=chosen)
        legend = lines.legend if lines is not None else ()
        if math.isfinite(loaded.baseline):
            legend = (*legend, Phrase(f"baseline {_percent(loaded.baseline)}", "truth", "baseline"))
        notes = (*([legend] if legend else ()), *translator_notes(loaded.translators, run))
        return Drawing(table=table, notes=notes, brush=scene.mark(self.name))

    def paper_drawing(self, scene: Scene) -> Drawing:
        """Without translators; with the gap, numbers of instances and a longer legend."""
        rows, baseline, lines = self._rows(scene), scene.loaded.baseline, self.lines(scene)
        legend = list(SIDE_PHRASES)
        if math.isfinite(baseline):
            text = f"constant mean position ({_percent(baseline)} %)"
            legend.append(Phrase(text, "truth", "baseline"))
        if lines is not None and len(rows) > 1:
            legend += lines.legend
            if not np.array_equal(lines.selected & lines.valid, lines.valid):
                legend.append(Phrase("grey: not selected", "unselected"))
            legend += cursor_phrases(lines.cursor)
        table = overview_table(rows, baseline, scene.state.run, lines, on_paper=True)
        return Drawing(table=table, notes=(tuple(legend),))

    def heading(self, scene: Scene) -> tuple[str, str]:
        """Which instances the numbers and the lines stand for."""
        parts = [scene.store.dataset.name, "accuracies over the instances that are new to each run"]
        lines = self.lines(scene) if len(self._rows(scene)) > 1 else None
        if lines is not None:
            count = f"{scene.state.expression} ({scene.state.count_text} instances)"
            parts.append(f"bands: {BAND_TEXT} of {count}" if lines.is_banded else f"lines: {count}")
            if lines.layers[0].is_banded:
                of_others = "those" if lines.is_banded else BAND_TEXT
                parts.append(f"grey bands: {of_others} of the others")
        return "Accuracy in simulation and in reality", "  ·  ".join(parts)

    def numbers(self, scene: Scene) -> Table:
        rows = []
        for row in scene.loaded.rows:
            errors = [
                figure for side in row.headlines
                for figure in (side.position, math.degrees(side.heading), side.recall)
            ]  # fmt: skip
            lost = max(side.not_localised for side in row.headlines)
            accuracies = [end for side in (row.sim, row.real) for end in (side.value, *side.bounds)]
            independent = row.real.sample.effective_n if row.real.sample else None
            rows.append((row.run, *errors, lost, *accuracies, row.n, independent,
                         scene.loaded.baseline, row.note))  # fmt: skip
        return NUMBERS, rows

    def summary(self, scene: Scene) -> str:
        run, parts = scene.state.run, []
        for row in scene.loaded.rows:
            errors = [
                f"{side} {found.text}" for side, found in zip(SIDES, row.headlines, strict=True)
            ]
            note = f" ({row.note})" if row.note else ""
            parts.append(f"{row.run}: {'; '.join(errors)}; accuracy sim {_with_bounds(row.sim)}, "
                         f"real {_with_bounds(row.real)}, {row.n} instances{note}")  # fmt: skip
        mean = _with_bounds(Interval.unknown(scene.loaded.baseline))
        text = (f"{'; '.join(parts) or 'no run'}. "
                f"Baseline (always the mean position): accuracy {mean}.")  # fmt: skip
        fitted = [
            f"{row.translator}: {', '.join(filter(None, (row.verdict, row.gain_text(run))))}"
            for row in ordered(scene.loaded.translators, run)
        ]
        return f"{text} Translators, gains on {run}: {'; '.join(fitted)}." if fitted else text

    def height(self, scene: Scene, width: int) -> int:
        if self.unavailable(scene.store):
            return FRAME_ROWS
        below = min(MOST_TRANSLATORS, len(scene.loaded.translators))
        runs = ROWS_PER_RUN * (len(scene.state.runs) - 1) + 1
        return runs + FRAME_ROWS + (below + 1 if below else 0)

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        lines, cursor = scene.loaded.accuracies(scene.state), scene.state.cursor
        if lines is None or cursor is None or panel.name not in lines.values:
            return None
        value = float(lines.values[panel.name][cursor])
        return (value, 0.0) if math.isfinite(value) else None

    def instance_at(self, scene: Scene, panel: PlotArea, cell: Point) -> int | None:
        """The selected instance whose line crosses the row of a run at a cell."""
        lines = scene.loaded.accuracies(scene.state)
        value, row = panel.to_data(*cell)
        if lines is None or panel.name not in lines.values or math.floor(row):
            return None  # between the rows of runs, where lines run to the next one
        low, high = (panel.to_data(x, 0.0)[0] for x in (panel.x, panel.x + panel.width))
        drawn = np.clip(lines.values[panel.name], low, high)
        known = scene.state.selected & np.isfinite(drawn)
        iid = int(np.argmin(np.where(known, np.abs(drawn - value), np.inf)))
        column = panel.to_cells(float(drawn[iid]), 0.0)[0]
        return iid if known[iid] and abs(column - cell[0]) <= 1 else None

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        if panel.name in session.state.runs:
            session.set_run(panel.name)

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        """The first cell includes the accuracies below the scale, which are drawn in it."""
        side = scene.loaded.lines.side if scene.loaded.lines else scene.state.side
        run = "" if panel.name == scene.state.run else f"run({string(panel.name)})."
        low, high = mark_range(mark)
        low = 0.0 if low < panel.to_data(panel.x + 1, 0.0)[0] else low
        whole = BrushShape(panel.name, ((low, 0.0), (high, 0.0)))
        return range_expression(panel, whole, f"{run}{side}.accuracy", 0.0, 1.0)


VIEW = OverviewView()


def _percent(share: float) -> str:
    return "n/a" if math.isnan(share) else f"{100 * share:.1f}"


def _with_bounds(share: Interval) -> str:
    """`98.0 % (97.6 to 98.3)`."""
    bounds = f" ({share.bounds_text(_percent)})" if share.is_known else ""
    return f"{_percent(share.value)} %{bounds}" if math.isfinite(share.value) else "n/a"
