"""Points in polygons: the even-odd rule, edges that belong to one side, and banded evaluation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.language import ExpressionError, parse
from s2rstore.language.lasso import MAX_CORNERS, Corners, bands, edges, inside

INTEGERS = st.integers(-4, 4).map(float)
GRID = np.array([(x, y) for x in range(-5, 6) for y in range(-5, 6)], dtype=float)


def points_inside(points: np.ndarray, corners: Corners) -> np.ndarray:
    return inside(bands(points[:, 0], points[:, 1]), corners, len(points))


def even_odd_rule(x: np.ndarray, y: np.ndarray, corners: Corners) -> np.ndarray:
    """The even-odd rule, edge by edge."""
    odd = np.zeros(x.size, dtype=bool)
    for edge in edges(corners):
        right = x < (y - edge.low) / edge.rise * edge.run + edge.x
        odd ^= (y >= edge.low) & (y < edge.high) & right
    return odd


def test_a_square_contains_only_its_left_and_lower_edge():
    square = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
    assert sorted(map(tuple, GRID[points_inside(GRID, square)])) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert (points_inside(GRID, square[::-1]) == points_inside(GRID, square)).all()


@given(
    corners=st.lists(st.tuples(INTEGERS, INTEGERS), min_size=3, max_size=9),
    point=st.integers(0, 120),
)
def test_adding_a_corner_changes_only_the_points_of_its_triangle(corners, point):
    """A corner between the last and the first adds or removes exactly the triangle's points."""
    enclosed = points_inside(GRID, tuple(corners))
    new_corner = (float(GRID[point][0]) / 3, float(GRID[point][1]) / 7)
    triangle = points_inside(GRID, (corners[-1], new_corner, corners[0]))
    assert (points_inside(GRID, (*corners, new_corner)) == (enclosed ^ triangle)).all()


def test_bands_give_the_unbanded_result():
    rng = np.random.default_rng(3)
    n = 120_000
    x, y = rng.normal(0, 3, n), np.round(rng.normal(0, 3, n), 2)
    x[::97], y[::89] = np.nan, np.nan
    x[5], y[6], y[7] = -np.inf, np.inf, -np.inf
    points = bands(x, y)
    assert len(points.starts) > 5
    angles = np.sort(rng.uniform(0, 2 * np.pi, 40))
    radii = rng.uniform(1, 6, 40)
    irregular = tuple(
        zip((radii * np.cos(angles)).tolist(), np.round(radii * np.sin(angles), 1), strict=True)
    )
    for corners in (irregular, irregular[:3], ((0.0, -9.0), (4.0, 9.0), (4.0, -9.0))):
        selected = inside(points, corners, n)
        assert (selected == even_odd_rule(x, y, corners)).all()
        assert 0 < selected.sum() < n


@pytest.mark.parametrize("n", [0, 1, 40_000])
def test_points_with_equal_y_form_one_band(n):
    points = bands(np.linspace(0, 1, n), np.full(n, 2.0))
    corners = ((-1.0, 1.0), (2.0, 1.0), (2.0, 3.0), (-1.0, 3.0))
    assert inside(points, corners, n).all()
    assert inside(points, corners[::-1], n).sum() == n


def test_a_lasso_has_3_to_64_corners():
    assert parse("lasso(" + ", ".join(["1"] * 2 * MAX_CORNERS) + ")")
    for count, problem in ((4, "not 2"), (2 * MAX_CORNERS + 2, "not 65"), (7, "no y")):
        with pytest.raises(ExpressionError, match=problem):
            parse("lasso(" + ", ".join(["1"] * count) + ")")
