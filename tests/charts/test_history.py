"""The history view: scale, days, outcomes and thresholds of the nights."""

import math
from dataclasses import replace

import numpy as np
import pytest

from s2rtui.canvas import RenderOptions
from s2rtui.charts.history import STYLES, history_model, history_plots
from s2rtui.charts.registry import BY_NAME
from s2rtui.charts.scene import LoadedData, Scene
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.drawing_layout import drawing_layout
from s2rtui.drawing.plot import Line
from s2rtui.drawing.plot_cells import column_of
from s2rtui.session.session import Session
from tests.charts.examples import history_drawing
from tests.support import gaps

SIZE = (100, 50)
WEEK = gaps.week()


def test_a_missing_night_leaves_a_gap():
    nights = tuple(night for night in WEEK if night.night.day != 18)
    assert np.diff(history_model(nights, 90).days).tolist() == [1, 2, 1, 1, 1]


def test_the_threshold_line_follows_its_changes():
    nights = tuple(
        replace(night, threshold=15.0 if n < 4 else 25.0) for n, night in enumerate(WEEK)
    )
    model = history_model(nights, 90)
    (line,) = [mark for mark in history_plots(model, 90)[1].marks if isinstance(mark, Line)]
    assert np.interp(model.days, line.x, line.y).tolist() == [15.0] * 4 + [25.0] * 3
    assert line.dashed


def test_axes_that_were_not_judged_are_not_drawn():
    nights = (*gaps.week()[:6], gaps.night(7, {"task": math.nan, "visual": 4.0}))
    model = history_model(nights, 90)
    tracks = {track.name: track for track in model.tracks}
    assert tracks["task"].statuses[-1] == "SKIPPED"
    assert math.isnan(tracks["dynamics"].column("value")[-1])
    assert "task  · skipped" in "\n".join(draw_cells(history_drawing(nights, 90), SIZE).lines())


def test_more_nights_than_columns_show_the_newest_and_say_so(tiny_store):
    nights = tuple(gaps.night(number, {"task": 5.0}) for number in range(1, 400))
    model = history_model(nights, 75)
    assert (model.days.size, model.older) == (75, 324)
    assert model.days[-1] == nights[-1].night.toordinal()
    session = Session(tiny_store)
    history = gaps.history(
        *(replace(night, dataset=session.store.dataset.name) for night in nights)
    )
    scene = Scene(session.store, session.state, LoadedData(history=history))
    lines = BY_NAME["history"].draw(scene, (80, 24), RenderOptions()).lines()
    assert "older" in lines[-1]
    assert "2027-12-19" in lines[-2]


def test_a_small_screen_shows_the_headline_and_the_worst_axes():
    lines = draw_cells(history_drawing(WEEK, 80), (80, 11)).lines()
    assert [line.split()[0] for line in lines if " G " in line] == ["headline", "task"]
    assert "no room for visual, dynamics" in lines[-1]


def test_outcomes_are_distinguishable_without_colour():
    for options in (RenderOptions(), RenderOptions(ascii=True)):
        assert len({getattr(options.glyphs, sign) for sign, _ in STYLES.values()}) == 4


CUT = (
    gaps.night(1, {"task": 20.0}),
    gaps.night(2, {"task": 159.8}),
    gaps.night(3, {"task": 14.0}),
    gaps.night(4, {"task": 118.0}, half_width=6.0),
    gaps.night(5, {"task": -33.5}),
)


@pytest.mark.parametrize("size", [(100, 40), (60, 30)])
@pytest.mark.parametrize("options", [RenderOptions(), RenderOptions(ascii=True)])
def test_what_lies_beyond_the_scale_is_an_arrow_with_its_number(size, options):
    drawing = history_drawing(CUT, size[0])
    canvas, layout = draw_cells(drawing, size, options), drawing_layout(drawing, size, options)
    up, down = options.glyphs.arrows[6], options.glyphs.arrows[2]
    for place in layout.plots:
        days = np.array([gap.night.toordinal() for gap in CUT], dtype=np.float64)
        columns = [place.left + column_of(place.plot.x, day, place.width) for day in days]
        first, last = place.top, place.top + place.rows - 1
        assert [canvas.char[first, column] == up for column in columns] == [
            False, True, False, False, False,
        ]  # fmt: skip
        assert canvas.char[last, columns[4]] == down
        assert "160" in canvas.lines()[first]
        assert "-33.5" in canvas.lines()[last]


def test_the_figure_marks_and_prints_a_cut_gap(monkeypatch):
    from matplotlib.axes import Axes

    from s2rtui.canvas import LIGHT
    from s2rtui.drawing.paper import draw_paper

    written: list[str] = []
    monkeypatch.setattr(Axes, "annotate", lambda self, text, *a, **k: written.append(text))
    draw_paper(history_drawing(CUT, 120), (900, 700), LIGHT)
    assert sorted(written) == sorted(["↑ 160", "↑", "↓ −33.5"] * 2)
    written.clear()
    draw_paper(Drawing(history_plots(history_model(WEEK, 120), 120)), (900, 700), LIGHT)
    assert not written
