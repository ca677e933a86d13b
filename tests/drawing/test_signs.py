"""Signs, changes and unselected instances in cells, compared with point-wise evaluation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import Canvas
from s2rtui.drawing.plane_marks import Changes, Signs, Unselected
from s2rtui.drawing.plot import Plot
from s2rtui.drawing.plot_cells import draw_marks
from s2rtui.drawing.points import (
    LEVELS,
    Grid,
    cell_bins,
    change_cells,
    level_shares,
    sign_cells,
)
from s2rtui.drawing.scale import Scale

N = 30
masks = arrays.arrays(np.bool_, N)
positions = arrays.arrays(
    np.float64,
    (N, 2),
    elements=st.floats(-4, 14) | st.sampled_from([np.nan, np.inf, -np.inf, 1e300]),
)
values = arrays.arrays(np.float64, N, elements=st.floats(-1, 3) | st.just(np.nan))


@st.composite
def grids(draw: st.DrawFn) -> Grid:
    """Cells of a plane, each twice as high as wide, with y upwards or downwards."""
    pitch, width, height = (
        draw(part) for part in (st.sampled_from([0.3, 0.5, 1.0]), st.integers(1, 12),
                                st.sampled_from([1, 3, 5]))
    )  # fmt: skip
    x, y = draw(st.floats(-2, 2)), draw(st.floats(-2, 2))
    ends = (y, y + 2 * height * pitch)
    up = Scale(*(ends if draw(st.booleans()) else ends[::-1]))
    return Grid(Scale(x, x + width * pitch), up, width, height)


def cells_of_points(grid: Grid, points: np.ndarray) -> list[tuple[int, int] | None]:
    """Cell (row, column) of each point, None outside the plane."""
    x, y, width, height = grid
    places = zip(x.fraction(points[:, 0]) * width, y.fraction(points[:, 1]) * height, strict=True)
    cells: list[tuple[int, int] | None] = []
    for column, up in places:
        inside = 0 <= column < width and 0 <= up < height
        cells.append((height - 1 - int(up), int(column)) if inside else None)
    return cells


@given(positions, values, masks, masks, masks, grids())
def test_a_cell_shows_its_largest_value(points, column, selected, valid, trained, grid):
    x, y = points.T.copy()
    signs = Signs(x, y, selected, valid, values=column, scale=(0.0, 2.0), trained=trained)
    shown = sign_cells(signs, grid)
    expected: dict[tuple[int, int], list[int]] = {}
    for index, cell in enumerate(cells_of_points(grid, points)):
        if cell is not None and selected[index] and valid[index]:
            expected.setdefault(cell, []).append(index)
    places = list(zip(shown.rows.tolist(), shown.columns.tolist(), strict=True))
    assert places == sorted(expected)
    for place, cell in enumerate(places):
        members = expected[cell]
        shares = np.clip(column[members] / 2, 0, 1)
        levels = np.minimum(np.floor(shares * LEVELS), LEVELS - 1) + 1
        top = np.nanmax(levels) if np.isfinite(levels).any() else 0
        np.testing.assert_equal(shown.values[place], level_shares(np.array(top)))
        assert shown.counts[place] == len(members)
        assert shown.trained[place] == trained[members].any()


@given(positions, values, masks, masks, grids())
def test_a_cell_shows_the_mean_of_its_changes(points, column, selected, valid, grid):
    x, y = points.T.copy()
    changes = Changes(x, y, selected, valid, column, 0.05, 1.0, ("", "", ""))
    shown = change_cells(changes, grid)
    expected: dict[tuple[int, int], list[float]] = {}
    for index, cell in enumerate(cells_of_points(grid, points)):
        if cell is not None and selected[index] and valid[index] and np.isfinite(column[index]):
            expected.setdefault(cell, []).append(column[index])
    places = list(zip(shown.rows.tolist(), shown.columns.tolist(), strict=True))
    assert places == sorted(expected)
    means = [np.mean(expected[cell]) for cell in places]
    np.testing.assert_allclose(shown.values, means, atol=1e-9)
    assert shown.counts.tolist() == [len(expected[cell]) for cell in places]


@given(positions, masks, masks, grids())
def test_unselected_instances_are_braille_dots(points, selected, valid, grid):
    x, y = points.T.copy()
    across, up, width, height = grid
    canvas = Canvas(width, height)
    draw_marks(canvas, Plot(across, up, (Unselected(x, y, selected, valid),)))
    cells = cells_of_points(grid, points)
    assert {(row, column) for row, column in np.argwhere(canvas.char != " ").tolist()} == {
        cell for at, cell in enumerate(cells) if cell and valid[at] and not selected[at]
    }


@pytest.mark.parametrize("size", [(300, 600), (10, 4)])
def test_cell_codes_of_large_planes_are_distinct(size):
    width, height = size
    x, y = np.array([0.5, width - 0.5]), np.array([0.5, height - 0.5])
    bins = cell_bins(x, y, Grid(Scale(0.0, width), Scale(height, 0.0), width, height))
    assert bins.codes.tolist() == [0, width * height - 1]
