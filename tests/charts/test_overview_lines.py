"""The overview: marks, numbers and scrolling, and the density and brushing of instance lines."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.marks import BrushShape, panel_at
from s2rtui.canvas.render_options import UNICODE
from s2rtui.charts.overview import bands
from s2rtui.charts.overview import lines as module
from s2rtui.charts.overview.layout import overview_layout, overview_panels
from s2rtui.charts.overview.lines import bin_count, line_density
from s2rtui.charts.overview.model import OverviewLines, overview_model
from s2rtui.charts.overview.terminal import draw_overview
from s2rtui.charts.scene import OverviewRow
from tests.charts.examples import ROWS, N, overview_lines

SIZE = (60, 16)
FEW_INSTANCES = 12
AXIS = (0.5, 1.0)
columns = arrays.arrays(np.float64, FEW_INSTANCES, elements=st.floats(0.3, 1.0) | st.just(np.nan))
masks = arrays.arrays(np.bool_, FEW_INSTANCES)


def rows(count: int) -> list[OverviewRow]:
    return [OverviewRow(f"run{index}", 0.9, 0.8) for index in range(count)]


def density_by_drawing(
    lines: OverviewLines, width: int, step: int, members: np.ndarray
) -> np.ndarray:
    """Lines per dot, computed by drawing one line after the other."""
    size, count = bin_count(width, FEW_INSTANCES), len(lines.values)
    grid = np.zeros((4 * ((count - 1) * step + 1), 2 * width))
    for iid in np.flatnonzero(members):
        for run in range(count - 1):
            ends = [float(column[iid]) for column in lines.values[run : run + 2]]
            if np.isnan(ends).any():
                continue
            share = [min(size - 1, max(0, int((end - AXIS[0]) / 0.5 * size))) for end in ends]
            start, stop = (2 * (0.5 + (part + 0.5) / size * (width - 1)) for part in share)
            for row in range(4 * step):
                first, last = (
                    int(start + (stop - start) * (offset / (4 * step))) for offset in (row, row + 1)
                )
                dots = range(first, last) if last > first else range(last + 1, first + 1)
                for dot in dots if last != first else (first,):
                    grid[4 * run * step + 2 + row, dot] += 1
    return grid


@given(columns, columns, columns, masks, masks)
def test_density_equals_individually_drawn_lines(first, second, third, selected, valid):
    lines = OverviewLines((first, second, third), selected, valid)
    layout = overview_layout(rows(3), 0, SIZE, lines)
    density = line_density(lines, AXIS, layout)
    highlighted = density_by_drawing(lines, layout.chart_width, layout.step, selected & valid)
    others = density_by_drawing(lines, layout.chart_width, layout.step, ~selected & valid)
    assert (density.highlighted == highlighted).all()
    assert (density.others == others).all()


def many_lines(count: int = 400, **changes: object) -> OverviewLines:
    """Evenly spread accuracies: 0.5 to 1 in the first run, 0.7 to 0.9 in the second."""
    spread = np.linspace(0, 1, count)
    columns = (0.5 + 0.5 * spread, 0.7 + 0.2 * spread)
    all_true = np.ones(count, dtype=np.bool_)
    return replace(OverviewLines(columns, all_true, all_true), **changes)


@pytest.mark.parametrize("count", [bands.MOST_LINES, bands.MOST_LINES + 1])
def test_more_lines_than_sixty_are_bands(count, monkeypatch):
    lines = many_lines(count)
    is_banded = count > bands.MOST_LINES
    assert lines.banded == (is_banded, False)
    layout = overview_layout(rows(2), 0, (80, 16), lines)
    unused = "_segments" if is_banded else "_bands"
    monkeypatch.setattr(module, unused, lambda *_: pytest.fail(f"{unused} is called"))
    highlighted = line_density(lines, AXIS, layout).highlighted
    assert highlighted.any()
    assert is_banded or highlighted[5].sum() >= count
    header = draw_overview(rows(2), None, 0, (80, 16), RenderOptions(), lines).lines()[0]
    assert ("bands: real" in header) == is_banded
    assert ("lines: real" in header) != is_banded


def test_selected_lines_are_drawn_above_bands_of_the_others():
    lines = many_lines(selected=np.arange(400) < 10)
    layout = overview_layout(rows(2), 0, (80, 16), lines)
    density = line_density(lines, AXIS, layout)
    assert lines.banded == (False, True)
    assert density.highlighted[2:-2].sum(axis=1).min() >= 10
    assert set(np.unique(density.others)) == {0, 1, 2, 3}


def test_bands_lie_at_the_quantiles():
    lines = many_lines()
    layout = overview_layout(rows(2), 0, (200, 60), lines)
    inner = line_density(lines, AXIS, layout).highlighted >= 2
    for row, (low, high) in ((2, (0.625, 0.875)), (-3, (0.75, 0.85))):
        dots = np.flatnonzero(inner[row])
        shares = (dots / 2 - 0.5) / (layout.chart_width - 1)
        found = AXIS[0] + (AXIS[1] - AXIS[0]) * shares
        assert found.min() == pytest.approx(low, abs=0.012)
        assert found.max() == pytest.approx(high, abs=0.012)


def test_quantiles_of_bins_agree_with_those_of_the_values():
    lines = many_lines()
    exact = bands.accuracy_quantiles(lines.values, lines.valid)
    counts = np.stack([np.histogram(c, bins=100, range=AXIS)[0] for c in lines.values])
    binned = AXIS[0] + (AXIS[1] - AXIS[0]) * bands.binned_quantiles(counts)
    np.testing.assert_allclose(binned, exact, atol=0.006)
    assert np.isnan(bands.accuracy_quantiles(lines.values, ~lines.valid)).all()
    assert np.isnan(bands.binned_quantiles(0 * counts)).all()


def test_bins_are_cached_across_selections(monkeypatch):
    lines = overview_lines()
    draw_overview(ROWS, 0.72, 0, SIZE, RenderOptions(), lines)
    monkeypatch.setattr(module, "_binned", lambda *_: pytest.fail("binned again"))
    draw_overview(ROWS, 0.72, 0, SIZE, RenderOptions(), replace(lines, selected=np.arange(N) < 9))


def test_the_axis_covers_drawn_lines():
    lines = overview_lines()
    tight, wide = overview_model(ROWS, 0.72).axis, overview_model(ROWS, 0.72, lines).axis
    lowest = np.percentile(lines.values[0][lines.valid], 1)
    assert wide[0] <= lowest < tight[0]
    assert wide[1] == 1.0


def test_rows_per_run_depend_on_the_height():
    lines = overview_lines()
    assert overview_layout(ROWS, 0, (60, 16)).step == 1
    assert overview_layout(ROWS, 0, (60, 16), lines).step == 6
    assert overview_layout(ROWS, 0, (60, 6), lines).step == 1
    tall_layout = overview_layout(ROWS, 0, (60, 80), lines)
    assert tall_layout.row_of(2) == tall_layout.top + 2 * tall_layout.step
    assert [tall_layout.run_at(tall_layout.row_of(index)) for index in range(3)] == [0, 1, 2]


def test_marks_and_numbers_are_drawn_over_lines():
    lines = overview_lines(cursor=None)
    canvas = draw_overview(ROWS, 0.72, 0, SIZE, RenderOptions(), lines)
    model, layout = overview_model(ROWS, 0.72, lines), overview_layout(ROWS, 0, SIZE, lines)
    for index, row in enumerate(ROWS[:2]):
        for value, glyph in ((row.sim_accuracy, UNICODE.sim), (row.real_accuracy, UNICODE.real)):
            assert value is not None
            assert canvas.char[layout.row_of(index), layout.column(value, model.axis)] == glyph
        assert canvas.lines()[layout.row_of(index)].split()[-2:] == [
            f"{100 * value:.1f}" for value in (row.sim_accuracy, row.real_accuracy) if value
        ]
    assert "no unseen instance" in canvas.lines()[layout.row_of(2)]


@pytest.mark.parametrize("side", ["sim", "real"])
def test_selected_lines_are_coloured_and_others_grey(side):
    lines = overview_lines(side=side, cursor=None)
    canvas = draw_overview(ROWS, None, 0, SIZE, RenderOptions(), lines)
    layout = overview_layout(ROWS, 0, SIZE, lines)
    band = slice(layout.row_of(0) + 1, layout.row_of(1))
    inked = np.char.greater(canvas.char[band], "\u2800")
    colours = canvas.fg[band][inked].astype(int)
    strongest = 2 if side == "sim" else 0
    highlighted = np.ptp(colours, axis=1) > 40
    assert highlighted.any()
    assert not highlighted.all()
    assert (colours[highlighted].argmax(axis=1) == strongest).all()
    assert f"lines: {side}" in canvas.lines()[0]


def test_unselected_lines_are_fainter_without_colours():
    lines = overview_lines(selected=np.zeros(N, dtype=np.bool_), cursor=None)
    all_selected = replace(lines, selected=np.ones(N, dtype=np.bool_))
    options = RenderOptions(mode=ColourMode.NONE)

    def ink(view: OverviewLines) -> int:
        drawn = "".join(draw_overview(ROWS, None, None, SIZE, options, view).lines())
        return sum(
            (ord(glyph) - 0x2800).bit_count() for glyph in drawn if "\u2800" < glyph < "\u2900"
        )

    assert 0 < ink(lines) < 0.75 * ink(all_selected)
    plain = RenderOptions(mode=ColourMode.NONE, ascii=True)
    layout = overview_layout(ROWS, None, SIZE, lines)
    for view, glyphs in ((lines, "."), (all_selected, "'+*#")):
        band = draw_overview(ROWS, None, None, SIZE, plain, view).lines()[
            layout.top + 1 : layout.row_of(1)
        ]
        assert set("".join(band)) <= {*glyphs, " "}
        assert set("".join(band)) & set(glyphs)


def test_the_cursor_s_line_is_drawn_on_top_with_its_accuracies():
    lines = overview_lines()
    canvas = draw_overview(ROWS, None, 0, SIZE, RenderOptions(), lines)
    model = overview_model(ROWS, None, lines)
    layout = overview_layout(ROWS, 0, SIZE, lines)
    for index in range(2):
        value = float(lines.values[index][50])
        line = canvas.lines()[layout.row_of(index)]
        assert line.split()[-1] == f"{100 * value:.1f}"
        glyph = canvas.char[layout.row_of(index), layout.column(value, model.axis)]
        assert glyph in (UNICODE.cursor, UNICODE.sim, UNICODE.real)
    assert f"{UNICODE.cursor} 50" in canvas.lines()[0]
    band = slice(layout.row_of(0) + 1, layout.row_of(1))
    white = (canvas.fg[band] == DARK.cursor).all(axis=-1) & (canvas.char[band] != " ")
    assert white.any(axis=1).all()
    assert canvas.lines()[layout.row_of(2)].split()[-1] == "n/a"


@given(
    size=st.tuples(st.integers(20, 120), st.integers(1, 50)),
    part=st.floats(0, 0.999),
    lined=st.booleans(),
)
def test_columns_convert_to_accuracies_and_back(size, part, lined):
    lines = overview_lines() if lined else None
    panels = overview_panels(ROWS, 0.72, 1, size, lines)
    model = overview_model(ROWS, 0.72, lines)
    for panel in panels:
        assert panel.shape == "range"
        column = panel.x + int(part * panel.width)
        for row in range(panel.y, panel.y + panel.height):
            value, down = panel.to_data(column + 0.5, row + 0.5)
            assert panel.to_cells(value, down) == pytest.approx((column + 0.5, row + 0.5))
            assert 0 <= value <= model.axis[1] + 1e-9


def test_each_run_has_a_panel_with_the_nearest_rows():
    lines = overview_lines()
    panels = overview_panels(ROWS, 0.72, 1, SIZE, lines)
    layout = overview_layout(ROWS, 1, SIZE, lines)
    assert [panel.name for panel in panels] == [row.run for row in ROWS]
    for y in range(layout.top, layout.top + layout.height):
        panel_found = panel_at(panels, layout.chart, y)
        index = layout.run_at(y)
        assert panel_found is not None
        assert index is not None
        assert panel_found.name == ROWS[index].run


def test_the_leftmost_column_includes_clipped_values():
    panel = overview_panels(ROWS, 0.72, 1, SIZE, overview_lines())[0]
    assert panel.to_data(panel.x + 0.5, panel.y)[0] == 0.0
    assert overview_panels(ROWS, 0.72, 1, SIZE)[0].to_data(panel.x + 0.5, panel.y)[0] > 0.5


@pytest.mark.parametrize(
    "options", [RenderOptions(), RenderOptions(mode=ColourMode.NONE, ascii=True)]
)
def test_a_marked_range_is_drawn_on_its_run(options):
    lines = overview_lines()
    mark = BrushShape("dataaug", ((0.75, 0.0), (0.9, 0.0)))
    canvas = draw_overview(ROWS, 0.72, 0, SIZE, options, lines, mark)
    panel = overview_panels(ROWS, 0.72, 0, SIZE, lines)[1]
    low, high = (int(panel.to_cells(value, 0.0)[0]) for value in (0.75, 0.9))
    for y in range(panel.y, panel.y + panel.height):
        assert canvas.char[y, low] == options.glyphs.scale_left
        assert canvas.char[y, high] == options.glyphs.scale_right
        assert (canvas.bg[y, low : high + 1] == DARK.highlight).all()
    assert not (canvas.char[panel.y - 1] == options.glyphs.scale_left).any()


ROWS_SIZE = (70, 10)


def test_the_visible_rows_follow_the_selected_run():
    for selected in (0, 17, 39):
        layout = overview_layout(rows(40), selected, (60, 8))
        assert layout.first <= selected < layout.first + layout.shown
        assert layout.run_at(layout.top) == layout.first
        assert layout.run_at(layout.top + layout.shown) is None


def test_a_line_shows_gap_baseline_and_selection():
    canvas = draw_overview(ROWS, 0.72, 1, ROWS_SIZE)
    lines = canvas.lines()
    assert lines[1].index("◇") < lines[1].index("◆")
    assert "━" in lines[1][lines[1].index("◇") : lines[1].index("◆")]
    assert lines[1].index("┊") == lines[2].index("┊")
    assert canvas.char[2, 0] == "▶"
    assert (canvas.bg[2] == DARK.highlight).all()
    assert not (canvas.bg[1] == DARK.highlight).any()
    same = draw_overview([OverviewRow("same", 0.9, 0.9)], None, 0, ROWS_SIZE)
    assert "◈" in same.lines()[1]
    assert "no run" in draw_overview([], None, None, ROWS_SIZE).lines()[0]
