"""Floor plans and heat are resampled by the mean over the area of each pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from s2rstore.records import Bounds
from s2rtui.analysis.map_frame import MapFrame, fit_frame, sample
from s2rtui.canvas import DEFAULT_OPTIONS
from s2rtui.charts.map.terminal import draw_map
from tests.charts.examples import map_input


def exact_mean(image: np.ndarray, bounds: Bounds, box: Bounds) -> float:
    """The mean of an image (H, W) that covers `bounds` over a box, without NaN."""
    rows, columns = image.shape
    across = np.linspace(bounds.x0, bounds.x1, columns + 1)
    down = np.linspace(bounds.y0, bounds.y1, rows + 1)
    wide = np.clip(np.minimum(across[1:], box.x1) - np.maximum(across[:-1], box.x0), 0, None)
    high = np.clip(np.minimum(down[1:], box.y1) - np.maximum(down[:-1], box.y0), 0, None)
    weight = np.where(np.isnan(image), 0, np.multiply.outer(high, wide))
    return float((weight * np.nan_to_num(image)).sum() / weight.sum()) if weight.sum() else np.nan


@given(st.integers(1, 40), st.integers(1, 40), st.floats(0.05, 0.9), st.booleans(), st.booleans())
@example(31, 29, 0.625, False, False)
def test_each_pixel_is_the_mean_of_its_area(
    rows: int, columns: int, pitch: float, y_down: bool, of_numbers: bool
) -> None:
    rng = np.random.default_rng(rows * 41 + columns)
    bounds, frame = Bounds(0.0, 0.0, 3.0, 2.0), MapFrame(-0.3, 0.7, pitch, 5, 4, y_down)
    is_interpolated = not of_numbers and max(rows / 2.0, columns / 3.0) * pitch >= 8
    if is_interpolated:  # a ramp, whose mean within a block is known to half its rise
        image = np.add.outer(np.arange(rows) / rows, np.arange(columns) / columns)
        image = np.round(127.5 * image).astype(np.uint8)
        tolerance = 1 + 127.5 * (pitch / 2.0 + pitch / 3.0) / 4
    else:
        image = rng.integers(0, 256, (rows, columns)).astype(np.uint8)
        tolerance = 2e-3
    if of_numbers:
        image = np.where(rng.random(image.shape) < 0.2, np.nan, image).astype(np.float32)
    shown = sample(image, bounds, frame, True)
    for row, column in np.ndindex(4, 5):
        x, y = -0.3 + column * pitch, 0.7 + (row if y_down else -row - 1) * pitch
        expected = exact_mean(image, bounds, Bounds(x, y, x + pitch, y + pitch))
        np.testing.assert_allclose(shown[row, column], expected, rtol=1e-4, atol=tolerance)


@pytest.mark.parametrize("period", [2, 3, 4, 5, 7, 9])
@pytest.mark.parametrize("cells", [33, 47, 58, 66])
def test_fine_stripes_show_no_pattern(period: int, cells: int) -> None:
    stripes = np.where(np.arange(1056) // period % 2, 255, 0).astype(np.uint8)
    plan = np.broadcast_to(stripes[:, None] // 2 + stripes // 2, (1056, 1056)).copy()
    bounds = Bounds(0.0, 0.0, 26.0, 26.0)
    shown = sample(plan, bounds, fit_frame(bounds, cells, cells, True), True)
    coarse = shown.reshape(-1)[np.isfinite(shown.reshape(-1))]
    pixels = 1056 / cells
    assert np.ptp(coarse) <= 255 * 2 * period / pixels


def test_two_maps_of_one_size_show_the_same_ground() -> None:
    plan = np.random.default_rng(1).integers(0, 256, (300, 300, 3)).astype(np.uint8)
    nobody = np.zeros(len(map_input().selected), dtype=np.bool_)
    first, second = (
        draw_map(
            map_input(floor_plan=plan, values=values, selected=nobody, cursor=None),
            (50, 24),
            DEFAULT_OPTIONS,
        )
        for values in (np.zeros(len(nobody)), np.linspace(0, 9, len(nobody)))
    )
    np.testing.assert_array_equal(first.bg[:18], second.bg[:18])
    np.testing.assert_array_equal(first.fg[1:18, 5:], second.fg[1:18, 5:])
