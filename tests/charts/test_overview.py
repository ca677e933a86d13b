"""The overview: rows of runs, their scale, brushes, and translators below them."""

from dataclasses import replace

import numpy as np
import pytest

import s2rstore
from s2rstore.index.transaction import edit
from s2rstore.intervals import Interval
from s2rtools.translator_evaluation.fit_into_store import FitRequest, fit_into_store
from s2rtui.canvas import DARK, Canvas, ColourMode, RenderOptions
from s2rtui.canvas.marks import BrushShape, PlotArea
from s2rtui.canvas.render_options import UNICODE
from s2rtui.charts.overview import (
    MOST_READ,
    VIEW,
    accuracy_scale,
    ordered,
    overview_table,
    translator_notes,
    translator_rows,
)  # fmt: skip
from s2rtui.charts.scene import (
    LoadedData,
    OverviewRow,
    RunAccuracies,
    Scene,
    TranslatorGain,
    TranslatorRow,
)
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.drawing.drawing import Drawing
from s2rtui.session import view_settings
from s2rtui.session.session import Session
from tests.charts.examples import ROWS, overview_drawing, overview_lines

SIZE = (60, 16)
TRANSLATORS = (
    TranslatorRow("mkl-real2sim", "real2sim", True,
                  (TranslatorGain("vanilla", 1.2, (0.84, 1.57)),)),
    TranslatorRow("fda", "real2sim", True,
                  (TranslatorGain("vanilla", 0.3, (-0.2, 0.8)),
                   TranslatorGain("other", -0.5, (-0.9, -0.1)),
                   TranslatorGain("shifted", 0.4, (0.1, 0.7), trained=True))),
    TranslatorRow("a-name-that-is-long", "sim2real", False),
    TranslatorRow("new", "sim2real", None),
)  # fmt: skip


def line_of(canvas: Canvas, run: str) -> tuple[int, str]:
    """The row and the text of a run."""
    return next((y, line) for y, line in enumerate(canvas.lines()) if run in line)


def panel_of(drawing: Drawing, run: str) -> PlotArea:
    return next(panel for panel in drawing_panels(drawing, SIZE) if panel.name == run)


def test_the_scale_holds_all_rows_the_baseline_and_the_lines():
    lines = overview_lines()
    tight, wide = (accuracy_scale(ROWS, 0.72, each, ("",)) for each in (None, lines))
    lowest = np.percentile(lines.values[0][lines.valid], 1)
    assert wide.low <= lowest < tight.low <= 0.72
    assert (wide.high, tight.high) == (1.0, 1.0)
    labels = [text for *_, text in wide.labels(40, 4, len, 1.0)]
    assert labels[-1] == "100"


def test_a_row_shows_both_accuracies_over_its_lines():
    drawing = overview_drawing(overview_lines(cursor=None))
    canvas = draw_cells(drawing, SIZE)
    for row in ROWS[:2]:
        y, line = line_of(canvas, row.run)
        for side, glyph in ((row.sim, UNICODE.sim), (row.real, UNICODE.real)):
            column = panel_of(drawing, row.run).to_cells(side.value, 0.0)[0]
            assert canvas.char[y, int(column)] == glyph
        assert line.split()[-2:] == [f"{100 * side.value:.1f}" for side in (row.sim, row.real)]
    _, line = line_of(canvas, "seen all")
    assert "no unseen instance" in line
    assert line.split()[-2:] == ["n/a", "n/a"]
    alike = (OverviewRow("same", Interval.unknown(0.9), Interval.unknown(0.9)),)
    same = Drawing(table=overview_table(alike, float("nan"), "same"))
    assert "◈" in draw_cells(same, SIZE).lines()[1]


@pytest.mark.parametrize(
    "options", [RenderOptions(), RenderOptions(mode=ColourMode.NONE, ascii=True)]
)
def test_a_brushed_range_is_drawn_on_its_run(options):
    drawing = overview_drawing(
        overview_lines(), brush=BrushShape("dataaug", ((0.75, 0.0), (0.9, 0.0)))
    )
    canvas, panel = draw_cells(drawing, SIZE, options), panel_of(drawing, "dataaug")
    low, high = (int(panel.to_cells(value, 0.0)[0]) for value in (0.75, 0.9))
    for y in range(panel.y, panel.y + panel.height):
        assert canvas.char[y, low] == options.glyphs.scale_left
        assert canvas.char[y, high] == options.glyphs.scale_right
        assert (canvas.bg[y, low : high + 1] == DARK.highlight).all()
    assert not (canvas.char[panel.y - 1] == options.glyphs.scale_left).any()


@pytest.fixture
def scene(tiny_store):
    session = Session(tiny_store)
    count = len(session.store.instances)
    values = {run: np.linspace(0.5, 1.0, count) for run in session.state.runs}
    sim, real = Interval.unknown(0.9), Interval.unknown(0.8)
    rows = tuple(OverviewRow(run, sim, real) for run in values)
    loaded = LoadedData(rows, lines=RunAccuracies("real", values), baseline=0.7)
    yield Scene(session.store, session.state, loaded)
    session.close()


def test_the_first_cell_selects_what_is_drawn_in_it(scene):
    panel = next(iter(VIEW.panels(scene, SIZE, RenderOptions())))
    start, end = (panel.to_data(column, panel.y) for column in (panel.x, panel.x + 4))
    assert start[0] > 0
    whole = VIEW.to_expression(scene, panel, BrushShape(panel.name, (end, start)))
    assert whole.startswith("real.accuracy:0..0.")
    later = panel.to_data(panel.x + 2, panel.y)
    part = VIEW.to_expression(scene, panel, BrushShape(panel.name, (later, end)))
    assert not part.startswith("real.accuracy:0..")


def test_an_instance_is_found_on_the_row_of_a_run_alone(scene):
    panel = next(iter(VIEW.panels(scene, SIZE, RenderOptions())))
    values = scene.loaded.lines.values[panel.name]
    iid = int(0.9 * values.size)
    column, row = panel.to_cells(float(values[iid]), 0.0)
    assert VIEW.instance_at(scene, panel, (column, row + 0.5)) == iid
    assert VIEW.instance_at(scene, panel, (column, row + 1.5)) is None
    first = int(np.flatnonzero(scene.state.selected)[0])
    values[first] = 0.1  # below the scale, drawn in the first cell
    assert panel.to_data(panel.x, row)[0] > values[first]
    assert VIEW.instance_at(scene, panel, (panel.x + 0.5, row + 0.5)) == first


def test_the_row_of_another_run_is_chosen_after_another_choice(tiny_store):
    session = Session(tiny_store)
    session.dispatch(view_settings.choose_row, VIEW.name, "vanilla")
    assert VIEW.chosen_row(Scene(session.store, session.state, LoadedData())) == 0
    session.set_run("dataaug")
    assert VIEW.drawing(Scene(session.store, session.state, LoadedData()), 60).table.chosen == 1
    session.close()


def test_translators_are_rows_of_verdicts_and_gains():
    notes = translator_notes(TRANSLATORS, "vanilla")
    lines = draw_cells(Drawing(notes=notes), (80, 5)).lines()
    assert "gains on vanilla" in lines[0]
    assert "accepted  gain +1.20 m (0.84 to 1.57)" in lines[1]
    assert "no clear gain" in lines[2]
    assert "refused" in lines[3]
    assert "not judged" in lines[4]
    more = translator_notes(TRANSLATORS * 2, "vanilla")
    assert "5 of 8" in more[0][0].text
    assert translator_notes((), "vanilla") == ()


def test_translators_leave_the_rows_of_runs():
    notes = translator_notes(TRANSLATORS, "vanilla")
    drawing = replace(overview_drawing(), notes=notes)
    low = draw_cells(drawing, (60, 7)).lines()
    assert all(row.run in "\n".join(low) for row in ROWS)
    assert low[-1].rstrip().endswith("…")


def test_gains_are_those_of_the_present_run_and_name_the_metric():
    row = TRANSLATORS[1]
    assert row.gain_text("vanilla") == "no clear gain; harms other"
    assert row.gain_text("other") == "gain -0.50 m (-0.90 to -0.10)"
    assert row.gain_text("shifted") == "training gain +0.40 m (0.10 to 0.70); harms other"
    assert row.gain_text("unjudged") == "harms other"


def test_the_present_run_decides_what_the_view_shows(scene):
    gains = (TranslatorGain("vanilla", 1.0, (0.5, 1.5)), TranslatorGain("dataaug", 2.0, (1.5, 2.5)))
    loaded = replace(scene.loaded, translators=(TranslatorRow("mkl", "real2sim", True, gains),))
    scenes = [
        replace(scene, state=replace(scene.state, run=run), loaded=loaded)
        for run in ("vanilla", "dataaug")
    ]
    texts = ["\n".join(VIEW.draw(each, (90, 30), RenderOptions()).lines()) for each in scenes]
    assert "+1.00 m" in texts[0]
    assert "+2.00 m" not in texts[0]
    assert "+2.00 m" in texts[1]
    assert VIEW.cache_key(scenes[0]) != VIEW.cache_key(scenes[1])
    assert "gains on dataaug: mkl: accepted, gain +2.00 m (1.50 to 2.50)" in VIEW.summary(scenes[1])


def test_accepted_translators_with_the_largest_gain_come_first(store_copy):
    for name in ("a", "b", "c"):
        fit_into_store(store_copy, FitRequest("mkl", name, "real2sim"), "")
    figures = (
        ("a", True, "error_gain", "vanilla", 0.5), ("b", True, "error_gain", "vanilla", 1.5),
        ("c", False, "error_gain", "vanilla", 9.0), ("a", True, "error_gain", "dataaug", 5.0),
        ("a", True, "trained_error_gain", "vanilla", 7.0),
    )  # fmt: skip
    with edit(store_copy) as draft:
        for name, accepted, metric, run, gain in figures:
            draft.update("translator", {"translator": name}, {"accepted": accepted})
            draft.insert_row(
                "translator_metric",
                {
                    "translator": name, "metric": metric, "reference": "translator",
                    "run": run, "value": gain, "low": gain - 0.1, "high": gain + 0.1,
                },
            )  # fmt: skip
    with s2rstore.open(store_copy) as store:
        rows = translator_rows(store)
    assert [row.translator for row in ordered(rows, "vanilla")] == ["b", "a", "c"]
    assert [row.translator for row in ordered(rows, "dataaug")] == ["a", "b", "c"]
    (a,) = (row for row in rows if row.translator == "a")
    assert [(gain.run, gain.value, gain.trained) for gain in a.gains] == [
        ("dataaug", 5.0, False), ("vanilla", 0.5, False), ("vanilla", 7.0, True),
    ]  # fmt: skip
    assert a.gains[0].interval == pytest.approx((4.9, 5.1))


def test_the_number_of_gains_that_are_read_is_limited(store_copy):
    fit_into_store(store_copy, FitRequest("mkl", "t", "real2sim"), "")
    with edit(store_copy) as draft:
        draft.rows(
            "INSERT INTO translator_metric (translator, metric, reference, run, value) "
            "SELECT 't', 'error_gain', 'translator', 'run' || range, 0 FROM range(5000)"
        )
    with s2rstore.open(store_copy) as store:
        (row,) = translator_rows(store)
    assert len(row.gains) == MOST_READ
