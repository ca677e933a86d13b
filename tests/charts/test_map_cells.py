"""Binned map points compared with point-wise evaluation."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.analysis.binning import selection_indices
from s2rtui.analysis.map_frame import MapFrame
from s2rtui.charts.shared.point_bins import (
    LEVELS,
    highest_levels,
    point_cells,
    point_dots,
    selected_counts,
    unselected_dots,
)

N = 30
masks = arrays.arrays(np.bool_, N)
positions = arrays.arrays(
    np.float64,
    (N, 2),
    elements=st.floats(-4, 14) | st.sampled_from([np.nan, np.inf, -np.inf, 1e300]),
)
values = arrays.arrays(np.float64, N, elements=st.floats(-1, 3) | st.just(np.nan))
frames = st.builds(
    MapFrame,
    x0=st.floats(-2, 2),
    y0=st.floats(-2, 2),
    pitch=st.sampled_from([0.3, 0.5, 1.0]),
    width=st.integers(1, 12),
    height=st.sampled_from([2, 6, 10]),
    y_down=st.booleans(),
)


def cells_of_points(frame: MapFrame, points: np.ndarray) -> list[tuple[int, int] | None]:
    """Cell (row, column) of each point, None outside the frame."""
    cells: list[tuple[int, int] | None] = []
    for column, row in frame.to_cells(points).tolist():
        inside = 0 <= column < frame.width and 0 <= row < frame.height // 2
        cells.append((int(row), int(column)) if inside else None)
    return cells


@given(positions, values, masks, masks, frames)
def test_a_cell_shows_its_largest_value(points, column, selected, valid, frame):
    shown = highest_levels(points, column, (0.0, 2.0), selection_indices(selected, valid), frame)
    expected = np.full((frame.height // 2, frame.width), -1)
    counts = np.zeros_like(expected)
    for index, cell in enumerate(cells_of_points(frame, points)):
        if cell is not None and selected[index] and valid[index]:
            share = np.clip(column[index] / 2, 0, 1)
            level = 0 if np.isnan(share) else min(LEVELS - 1, int(share * LEVELS)) + 1
            expected[cell] = max(expected[cell], level)
            counts[cell] += 1
    assert (shown.level == expected).all()
    assert (shown.count == counts).all()


@given(positions, masks, masks, frames)
def test_counts_and_unselected_dots_match_the_points(points, selected, valid, frame):
    selection, member = selection_indices(selected, valid), selected & valid
    highlighted = selected_counts(points, selection, frame)
    others = unselected_dots(points, selection, frame)
    cells = [(at, cell) for at, cell in enumerate(cells_of_points(frame, points)) if cell]
    places = zip(*np.nonzero(highlighted), strict=True)
    assert {place: highlighted[place] for place in places} == Counter(
        cell for at, cell in cells if member[at]
    )
    cells_with_dots = others.reshape(frame.height // 2, 4, frame.width, 2).any(axis=(1, 3))
    assert set(zip(*np.nonzero(cells_with_dots), strict=True)) == {
        cell for at, cell in cells if valid[at] and not member[at]
    }


def test_cell_codes_are_cached():
    points = np.random.default_rng(1).uniform(0, 5, (N, 2))
    frame = MapFrame(0.0, 0.0, 0.5, 10, 10, True)
    assert point_dots(points, frame) is point_dots(points, frame)
    assert point_cells(points, frame) is point_cells(points, frame)


@pytest.mark.parametrize("size", [(300, 600), (10, 4)])
def test_cell_codes_of_large_frames_are_distinct(size):
    width, height = size
    frame = MapFrame(0.0, 0.0, 1.0, width, height, True)
    column = point_cells(np.array([[0.5, 0.5], [width - 0.5, height - 0.5]]), frame)
    assert column.codes.tolist() == [0, width * (height // 2) - 1]
