"""The compare view: differences of two runs compared with direct subtraction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis.binning import selection_indices
from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.charts.compare.model import CompareInput, cell_means, compare_model
from s2rtui.charts.compare.terminal import compare_layout, draw_compare
from tests.charts.examples import BOUNDS, N, compare_input

SIZE = (80, 26)
errors = arrays.arrays(np.float64, N, elements=st.floats(0, 4) | st.just(np.nan))
masks = arrays.arrays(np.bool_, N)


@given(errors, errors, masks, masks)
def test_the_summary_counts_improved_and_worse_instances(
    first: np.ndarray, second: np.ndarray, selected: np.ndarray, valid: np.ndarray
) -> None:
    view = compare_input(first=first, second=second, selected=selected, valid=valid)
    summary = compare_model(view).summary
    differences = (first - second)[selected & valid]
    known = differences[np.isfinite(differences)]
    assert summary.improved == (known > 0.05).sum()
    assert summary.worse == (known < -0.05).sum()
    assert summary.equal == (np.abs(known) <= 0.05).sum()
    assert summary.unknown == np.isnan(differences).sum()
    assert summary.mean == pytest.approx(known.mean() if known.size else np.nan, nan_ok=True)


@given(errors, errors, masks, masks)
def test_a_cell_shows_the_mean_of_its_selected_instances(
    first: np.ndarray, second: np.ndarray, selected: np.ndarray, valid: np.ndarray
) -> None:
    view = compare_input(first=first, second=second, selected=selected, valid=valid)
    frame = compare_layout(view, (30, 8)).frame
    columns, rows, means, counts = cell_means(
        view.truth, first, second, selection_indices(selected, valid), frame
    )
    differences = first - second
    cells = np.floor(frame.to_cells(view.truth))
    known = selected & valid & np.isfinite(differences)
    inside = ((cells >= 0) & (cells < (frame.width, frame.height // 2))).all(axis=1)
    assert len(means) == len(np.unique(cells[known & inside], axis=0))
    for column, row, mean, count in zip(columns, rows, means, counts, strict=True):
        in_cell = known & (cells == (column, row)).all(axis=1)
        assert count == in_cell.sum()
        assert mean == pytest.approx(differences[in_cell].mean(), abs=1e-9)


def three_points() -> CompareInput:
    """The second run is better at the left, the first in the middle, neither at the right."""
    all_true = np.ones(3, dtype=np.bool_)
    return CompareInput(
        np.array([[4.0, 5.0], [10.0, 5.0], [16.0, 5.0]]),
        np.array([3.0, 0.5, 1.0]),
        np.array([1.0, 1.5, 1.04]),
        all_true,
        all_true,
        BOUNDS,
        ("vanilla", "dataaug"),
    )


@pytest.mark.parametrize(
    ("options", "glyphs"),
    [
        (RenderOptions(), "▴▾•"),
        (RenderOptions(mode=ColourMode.ANSI), "▴▾•"),
        (RenderOptions(mode=ColourMode.NONE), "+-="),
        (RenderOptions(ascii=True), "+-="),
    ],
)
def test_glyphs_show_the_better_run(options: RenderOptions, glyphs: str) -> None:
    view = three_points()
    canvas, layout = draw_compare(view, SIZE, options), compare_layout(view, SIZE, None, options)
    cells = np.floor(layout.frame.to_cells(view.truth)).astype(int)
    glyphs_drawn = [canvas.char[row, column + layout.x] for column, row in cells]
    assert "".join(glyphs_drawn) == glyphs


def test_colours_diverge_at_zero() -> None:
    view = three_points()
    canvas, layout = draw_compare(view, SIZE), compare_layout(view, SIZE)
    cells = np.floor(layout.frame.to_cells(view.truth)).astype(int)
    better, worse, equal = (canvas.fg[row, column + layout.x] for column, row in cells)
    assert int(better[0]) > int(better[2]) + 80
    assert int(worse[2]) > int(worse[0]) + 80
    assert np.ptp(equal.astype(int)) < 60


def test_the_legend_shows_counts_and_the_mean() -> None:
    text = "\n".join(draw_compare(three_points(), (120, 26)).lines())
    for part in ("1 better in dataaug", "1 better in vanilla", "1 within 0.05 m", "mean +0.32 m"):
        assert part in text
    assert "real error, vanilla - dataaug -2 " in text
    narrow = "\n".join(draw_compare(three_points(), (50, 20)).lines())
    assert "▲ 1  ▼ 1  ● 1" in narrow


def test_unselected_points_are_grey_and_the_cursor_is_marked() -> None:
    view = replace(three_points(), selected=np.array([True, False, False]), cursor=2)
    canvas, layout = draw_compare(view, SIZE), compare_layout(view, SIZE)
    cells = np.floor(layout.frame.to_cells(view.truth)).astype(int)
    column, row = cells[1]
    assert 0x2800 < ord(canvas.char[row, column + layout.x]) <= 0x28FF
    assert tuple(canvas.fg[row, column + layout.x]) == DARK.unselected
    column, row = cells[2]
    assert canvas.char[row, column + layout.x] == "◉"


def test_empty_selections_and_missing_values_can_be_drawn() -> None:
    none_selected = np.zeros(N, dtype=np.bool_)
    missing = np.full(N, np.nan)
    draw_compare(compare_input(selected=none_selected), SIZE)
    summary = compare_model(compare_input(first=missing)).summary
    assert (summary.improved, summary.worse, summary.equal, summary.unknown) == (0, 0, 0, 15)
    assert "mean" not in "\n".join(draw_compare(compare_input(first=missing), SIZE).lines())
