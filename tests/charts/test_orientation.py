"""The orientation view: counts, directions, means and readability in every mode."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.marks import BrushShape, mark_arc, wrap_degrees
from s2rtui.charts.orientation.dial import bar_dots, dial_of
from s2rtui.charts.orientation.model import BINS, EXACTLY_UP_TO, orientation_model
from s2rtui.charts.orientation.terminal import draw_orientation, orientation_layout
from s2rtui.charts.orientation.terminal import orientation_panels as surface
from tests.charts.examples import N, orientation_input

SIZE = (50, 10)
COUNT = 30
headings = arrays.arrays(np.float64, COUNT, elements=st.floats(-9, 9) | st.just(np.nan))
masks = arrays.arrays(np.bool_, COUNT)


def one_direction(degrees: float, **changes):
    """All instances face the same direction and are selected."""
    column = np.full(N, math.radians(degrees))
    ones = np.ones(N, dtype=np.bool_)
    view = {"sim": column, "truth": column, "real": column, "selected": ones, "valid": ones}
    return orientation_input(**(view | {"cursor": None} | changes))


@given(headings, masks, masks)
def test_counts_and_means_are_those_of_selected_instances(column, selected, valid):
    view = orientation_input(
        sim=column, truth=column, real=column, selected=selected, valid=valid, cursor=None
    )
    edges = np.arange(BINS + 1) * 5.0 - 180
    panel = orientation_model(view).panels[0]
    for mask, counts in ((selected & valid, panel.highlighted), (valid, panel.total)):
        selected_headings = column[mask & np.isfinite(column)]
        wrapped = np.array([wrap_degrees(degrees) for degrees in np.degrees(selected_headings)])
        expected, _ = np.histogram(wrapped, edges)
        assert counts.sum() == selected_headings.size
        on_edge = np.abs(wrapped[:, None] - edges).min(initial=np.inf) < 1e-9
        apart = np.abs(np.cumsum(counts) - np.cumsum(expected)).max(initial=0)
        assert apart <= on_edge * selected_headings.size
    selected_headings = column[selected & valid & np.isfinite(column)]
    if selected_headings.size:
        vector = np.exp(1j * selected_headings).mean()
        assert panel.resultant == pytest.approx(abs(vector), abs=1e-12)
        if abs(vector) > 1e-6:
            difference = wrap_degrees(panel.mean - math.degrees(np.angle(vector)))
            assert difference == pytest.approx(0, abs=1e-6)
    else:
        assert math.isnan(panel.mean)


def test_means_of_many_instances_are_accurate():
    random = np.random.default_rng(3)
    number = 4 * EXACTLY_UP_TO
    ones = np.ones(number, dtype=np.bool_)
    selected = random.random(number) < 0.6
    spread = random.vonmises(1.0, 2.0, number)
    grid = np.radians(random.choice([0.0, 90.0, 91.0], number))
    view = orientation_input(
        sim=spread, truth=grid, real=grid, selected=selected, valid=ones, cursor=None
    )
    model = orientation_model(view)
    vector = np.exp(1j * spread[selected]).mean()
    assert model.panels[0].mean == pytest.approx(math.degrees(np.angle(vector)), abs=0.1)
    assert model.panels[0].resultant == pytest.approx(abs(vector), abs=1e-3)
    vector = np.exp(1j * grid[selected]).mean()
    assert model.panels[1].mean == pytest.approx(math.degrees(np.angle(vector)), abs=0.1)


@pytest.mark.parametrize(
    ("degrees", "y_down", "direction"),
    [(2, True, "right"), (92, True, "down"), (92, False, "up"), (-88, True, "up"),
     (178, True, "left")],
)  # fmt: skip
@pytest.mark.parametrize("options", [RenderOptions(), RenderOptions(ascii=True)])
def test_bars_have_the_direction_of_the_map(degrees, y_down, direction, options):
    size = (120, 24)
    view = one_direction(degrees, y_down=y_down)
    canvas = draw_orientation(view, size, options)
    for panel, colour in zip(
        surface(view, size, options), (DARK.sim, DARK.truth, DARK.real), strict=True
    ):
        rows, columns = (slice(panel.y, panel.y + panel.height),
                         slice(panel.x, panel.x + panel.width))  # fmt: skip
        inked = (canvas.fg[rows, columns] == colour).all(axis=-1)
        inked &= canvas.char[rows, columns] != " "
        row, column = (part.mean() for part in np.nonzero(inked))
        across, down = column + 0.5 - panel.width / 2, 2 * (row + 0.5 - panel.height / 2)
        offsets = {"right": across, "left": -across, "down": down, "up": -down}
        assert max(offsets, key=lambda name: offsets[name]) == direction
        assert offsets[direction] > 3


@given(arrays.arrays(np.float64, BINS, elements=st.sampled_from([0.0, 0.01, 0.3, 1.0])))
def test_bar_lengths_are_proportional_to_counts(lengths):
    dial = dial_of(0, 0, 40, 20, True, (0, 0))
    dots = bar_dots(dial, 40, 20, lengths)
    rows, columns = np.nonzero(dots)
    data_points = [
        dial.to_data((column + 0.5) / 2, (row + 0.5) / 4)
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
    ]
    turns = np.array([data_point[0] for data_point in data_points])
    radii = np.array([data_point[1] for data_point in data_points])
    dot = 0.75 / (dial.rim - dial.ring)
    for index in np.flatnonzero(lengths > 0):
        bin_centre = (index + 0.5) * 5 - 180
        near = np.abs((turns - bin_centre + 180) % 360 - 180) < 5
        assert radii[near].max() > lengths[index] - dot
    assert (radii > -dot).all()
    if not (lengths > 0).any():
        assert not dots.any()
    elif lengths.max() < 1:
        assert radii.max() < lengths.max() + dot + 0.5 / (dial.rim - dial.ring)


def test_grey_bars_are_scaled_by_the_selected_share():
    view = orientation_input()
    model = orientation_model(view)
    highlighted, total = (sum(part.sum() for part in counts) for counts in zip(
        *((panel.highlighted, panel.total) for panel in model.panels), strict=True))  # fmt: skip
    assert model.whole == pytest.approx(model.peak * total / highlighted)
    for panel in model.panels:
        for bars in model.lengths(panel):
            assert bars.max() <= 1 + 1e-9
    all_selected = orientation_model(one_direction(10))
    assert all_selected.peak == all_selected.whole == N


def test_scale_and_means_are_written():
    lines = draw_orientation(one_direction(-93), SIZE).lines()
    assert lines[0].count(f"max {N}") == 3
    assert lines[-1].count("-93° R 1.00") == 3
    nobody = one_direction(5, selected=np.zeros(N, dtype=np.bool_))
    assert "none" in draw_orientation(nobody, SIZE).lines()[-1]


@pytest.mark.parametrize("size", [(50, 4), (40, 3), (80, 5)])
def test_small_sizes_use_strips_instead_of_dials(size):
    view = one_direction(92)
    layout = orientation_layout(view, size)
    assert layout.dial is None
    assert layout.count in (36, 72)
    canvas = draw_orientation(view, size)
    for panel in surface(view, size):
        row = canvas.char[panel.y + panel.height - 1, panel.x : panel.x + panel.width]
        filled = np.flatnonzero(row == "█")
        assert filled.size == panel.width // layout.count
        degrees = [panel.to_data(panel.x + offset + 0.5, panel.y + 0.5)[0] for offset in filled]
        assert all(abs(turn - 92) < 10 for turn in degrees)


def test_selected_and_others_differ_without_colours():
    none_selected = np.zeros(N, dtype=np.bool_)
    for options, highlighted in (
        (RenderOptions(mode=ColourMode.NONE), "▀▄█▌▐▘▝▖▗▛▜▙▟"),
        (RenderOptions(ascii=True), "#"),
    ):
        size = (120, 24)
        drawn, grey = (
            "".join(draw_orientation(one_direction(10, **change), size, options).lines()[3:])
            for change in ({}, {"selected": none_selected})
        )
        assert any(glyph in drawn for glyph in highlighted)
        assert not any(glyph in grey for glyph in highlighted)
        assert "".join(grey.split()) != ""


def test_the_cursor_direction_is_marked_in_each_panel():
    view = orientation_input(cursor=30)
    canvas = draw_orientation(view, (100, 20))
    for panel, column in zip(
        surface(view, (100, 20)), (view.sim, view.truth, view.real), strict=True
    ):
        x, y = panel.to_cells(math.degrees(column[30]), 1.0)
        cursor_cells = np.argwhere(
            canvas.char[panel.y : panel.y + panel.height, panel.x : panel.x + panel.width] == "◉"
        )
        assert len(cursor_cells) == 1
        row, column_at = cursor_cells[0]
        assert abs(column_at + panel.x - x) <= 1
        assert abs(row + panel.y - y) <= 1


@pytest.mark.parametrize(
    ("ends", "arc"),
    [((30.0, 50.0), (40.0, 10.0)), ((170.0, -160.0), (-175.0, 15.0)),
     ((160.0, 200.0), (180.0, 20.0)), ((-20.0, 240.0), (110.0, 130.0)),
     ((50.0, 30.0), (-140.0, 170.0)), ((-200.0, 200.0), (-20.0, 180.0))],
)  # fmt: skip
def test_a_brush_covers_the_arc_from_its_first_to_its_last_end(ends, arc):
    centre, half = mark_arc(BrushShape("sim", ((ends[0], 1.0), (ends[1], 1.0))))
    assert wrap_degrees(centre - arc[0]) == pytest.approx(0)
    assert half == pytest.approx(arc[1])


@pytest.mark.parametrize("size", [(100, 20), (60, 4)])
def test_a_pending_arc_is_highlighted_with_marked_ends(size):
    mark = BrushShape("truth", ((170.0, 1.0), (-120.0, 1.0)))
    view = orientation_input(mark=mark, cursor=None)
    canvas = draw_orientation(view, size, RenderOptions(mode=ColourMode.NONE))
    _, truth, _ = surface(view, size)
    assert "".join(canvas.lines()).count("+") == 2
    ground = (canvas.bg == DARK.highlight).all(axis=-1)
    assert ground.any()
    for row, column in np.argwhere(ground):
        assert truth.holds(int(column), int(row))
        degrees = truth.to_data(column + 0.5, row + 0.5)[0]
        assert abs(wrap_degrees(degrees - -155)) <= 35 + 1e-6
