"""The history view: every night at its day, with interval, outcome glyph and threshold."""

import math
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from s2rtui.canvas import DARK, LIGHT, RenderOptions
from s2rtui.charts.history.model import history_model
from s2rtui.charts.history.paper import history_figure
from s2rtui.charts.history.terminal import (
    LABELS,
    ChartRows,
    draw_history,
    history_layout,
    status_glyph,
)
from tests.support import gaps

SIZE = (100, 50)
WEEK = gaps.week()


def test_each_axis_has_a_track_with_the_values_of_the_nights():
    model = history_model(WEEK, 90)
    assert [track.name for track in model.tracks] == ["headline", "visual", "task", "dynamics"]
    headline, visual, task, dynamics = model.tracks
    assert task.value.tolist() == [7.0] * 4 + [27.0] * 3
    assert task.low.tolist() == [5.0] * 4 + [25.0] * 3
    assert headline.value.tolist() == [14.0] * 4 + [27.0] * 3
    assert task.statuses == ("PASS",) * 4 + ("FAIL",) * 3
    assert set(dynamics.statuses) == {"INCONCLUSIVE"}
    assert set(visual.statuses) == {"PASS"}
    assert np.diff(model.days).tolist() == [1] * 6
    assert (model.span, model.older) == (7, 0)


def test_all_tracks_share_one_scale():
    low, high = history_model(WEEK, 90).scale
    assert low == 0
    assert high == 29
    with_outliers = (gaps.night(1, {"task": 900.0, "visual": -300.0}),)
    assert history_model(with_outliers, 90).scale == (-20.0, 120.0)


@pytest.mark.parametrize("size", [(100, 50), (60, 40), (200, 60)])
def test_each_night_is_drawn_at_its_day_and_value(size):
    canvas = draw_history(WEEK, size)
    model = history_model(WEEK, size[0] - LABELS)
    layout = history_layout(model, size)
    assert len(layout.charts) == 4
    for index, _, top, rows in layout.charts:
        track = model.tracks[index]
        for night_index, day in enumerate(model.days.tolist()):
            column = layout.column(day, model)
            chart, limit = ChartRows(model.scale, top, rows), float(model.thresholds[night_index])
            row = chart.of(float(track.value[night_index]), limit)
            assert canvas.char[row, column] == status_glyph(
                track.statuses[night_index], RenderOptions()
            )
            drawn_rows = [y for y in range(top, top + rows) if canvas.char[y, column] not in " ─"]
            interval_rows = [
                chart.of(float(end[night_index]), limit) for end in (track.high, track.low)
            ]
            assert (drawn_rows[0], drawn_rows[-1]) == tuple(interval_rows)


def test_a_missing_night_leaves_a_gap():
    nights = tuple(night for night in WEEK if night.night.day != 18)
    model = history_model(nights, 90)
    layout = history_layout(model, SIZE)
    columns = [layout.column(day, model) for day in model.days.tolist()]
    assert np.diff(columns).tolist() == [8, 16, 8, 8, 8]


def test_the_threshold_line_follows_its_changes():
    view = tuple(replace(night, threshold=15.0 if n < 4 else 25.0) for n, night in enumerate(WEEK))
    canvas = draw_history(view, SIZE)
    model = history_model(view, SIZE[0] - LABELS)
    layout = history_layout(model, SIZE)
    _, _, top, rows = next(c for c in layout.charts if model.tracks[c[0]].name == "visual")
    for index, day in enumerate(model.days.tolist()):
        row = ChartRows(model.scale, top, rows).line(float(model.thresholds[index]))
        assert canvas.char[row, layout.column(day, model) - 1] == "─"
        others = [y for y in range(top, top + rows) if y != row]
        assert "─" not in canvas.char[others, layout.column(day, model) - 1]


def test_axes_that_were_not_judged_are_not_drawn():
    nights = (*gaps.week()[:6], gaps.night(7, {"task": math.nan, "visual": 4.0}))
    model = history_model(nights, 90)
    tracks = {track.name: track for track in model.tracks}
    assert tracks["task"].statuses[-1] == "SKIPPED"
    assert math.isnan(tracks["dynamics"].value[-1])
    text = "\n".join(draw_history(nights, SIZE).lines())
    assert "task  · skipped  " in text


def test_more_nights_than_columns_show_the_newest():
    nights = tuple(gaps.night(number, {"task": 5.0}) for number in range(1, 400))
    model = history_model(nights, 75)
    assert (model.days.size, model.older) == (75, 324)
    assert model.days[-1] == nights[-1].night.toordinal()
    assert "324 older" in draw_history(nights, (80, 24)).lines()[-1]


def test_a_small_screen_shows_the_headline_and_the_worst_axes():
    model = history_model(WEEK, 75)
    layout = history_layout(model, (80, 14))
    assert [model.tracks[chart[0]].name for chart in layout.charts] == ["headline", "task"]
    assert "no room for visual, dynamics" in draw_history(WEEK, (80, 14)).lines()[-1]


def test_outcomes_are_distinguishable_without_colour():
    for options in (RenderOptions(), RenderOptions(ascii=True)):
        glyphs = {
            status_glyph(status, options) for status in ("PASS", "FAIL", "INCONCLUSIVE", "SKIPPED")
        }
        assert len(glyphs) == 4


@given(st.floats(-1e6, 1e6), st.floats(0.1, 40), st.integers(1, 30), st.sampled_from([30.0, 120.0]))
def test_every_value_is_drawn_on_its_side_of_the_threshold(value, threshold, rows, maximum):
    chart = ChartRows((0.0, max(maximum, 1.6 * threshold)), 5, rows)
    row, line = chart.of(value, threshold), chart.line(threshold)
    assert 5 <= row < 5 + rows
    assert chart.of(value + 1, threshold) <= row
    if rows >= 3:
        assert (row < line, row > line) == (value > threshold, value < threshold)


@pytest.mark.parametrize("theme", [DARK, LIGHT], ids=["dark", "light"])
def test_the_figure_marks_failed_nights(theme):
    figure = history_figure(WEEK, (1600, 1100), theme)
    assert figure == history_figure(WEEK, (1600, 1100), theme)
    image = Image.open(BytesIO(figure)).convert("RGB")
    assert image.size == (1600, 1100)
    pixels = np.asarray(image).astype(int)
    red = (np.abs(pixels - theme.real).sum(axis=2) < 20).any(axis=0)
    groups = np.count_nonzero(np.diff(red.astype(int)) == 1)
    assert groups == 3


CUT = (
    gaps.night(1, {"task": 20.0}),
    gaps.night(2, {"task": 159.8}),
    gaps.night(3, {"task": 14.0}),
    gaps.night(4, {"task": 118.0}, half_width=6.0),
    gaps.night(5, {"task": -33.5}),
)


@pytest.mark.parametrize(("size", "legend"), [((100, 50), 1), ((30, 10), 3)])
@pytest.mark.parametrize("options", [RenderOptions(), RenderOptions(ascii=True)])
def test_what_lies_beyond_the_scale_is_marked(size, legend, options):
    canvas = draw_history(CUT, size, options)
    model = history_model(CUT, 90)
    layout = history_layout(model, size, legend=legend)
    up, down = options.glyphs.arrows[6], options.glyphs.arrows[2]
    assert model.is_cut
    fail = status_glyph("FAIL", options)
    for _, _, top, rows in layout.charts:
        columns = [layout.column(day, model) for day in model.days.tolist()]
        drawn = [str(canvas.char[top, column]) for column in columns]
        assert drawn[1] == up
        assert (drawn[3], canvas.char[top, columns[3] + 1]) == (fail, up)
        assert up not in (drawn[0], drawn[2], drawn[4])
        bottom = [canvas.char[top + rows - 1, column] == down for column in columns]
        assert bottom == [False] * 4 + [True]


@pytest.mark.parametrize("width", [60, 100, 200])
def test_only_the_value_of_a_cut_gap_is_printed(width):
    canvas = draw_history(CUT, (width, 40))
    layout = history_layout(history_model(CUT, 90), (width, 40))
    for _, _, top, rows in layout.charts:
        assert "159.8" in canvas.lines()[top]
        assert "118" not in canvas.lines()[top]
        assert "-33.5" in canvas.lines()[top + rows - 1]
    assert "↑↓ off scale" in canvas.lines()[-1]
    assert not history_model(WEEK, 90).is_cut
    assert "↑" not in "".join(draw_history(WEEK, (width, 40)).lines())


def test_the_figure_marks_and_prints_a_cut_gap(monkeypatch):
    from matplotlib.axes import Axes

    written: list[str] = []
    monkeypatch.setattr(Axes, "annotate", lambda self, text, *a, **k: written.append(text))
    history_figure(CUT, (900, 700))
    assert written == ["↑ 159.8", "↑", "↓ −33.5"] * 2
    written.clear()
    history_figure(WEEK, (900, 700))
    assert not written
