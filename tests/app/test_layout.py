"""The layout of the views: inside the screen, without overlap, rows by need."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from textual.geometry import Region

from s2rtui.app.layout import MIN_SIZE, LayoutRequest, arrange, size_class
from s2rtui.charts.registry import VIEWS

TABS = [view.name for view in VIEWS if view.pane == "tab"]
CENTRES = [view.name for view in VIEWS if view.pane == "centre"]


def cells(rectangle: Region) -> set[tuple[int, int]]:
    return {
        (x, y)
        for x in range(rectangle.x, rectangle.x + rectangle.width)
        for y in range(rectangle.y, rectangle.y + rectangle.height)
    }


@given(
    width=st.integers(MIN_SIZE[0], 260),
    height=st.integers(MIN_SIZE[1], 80),
    tab=st.sampled_from(TABS),
    centre=st.sampled_from(CENTRES),
    active=st.integers(0, 2),
    rows=st.integers(3, 30),
)
def test_views_stay_inside_the_screen_and_do_not_overlap(width, height, tab, centre, active, rows):
    view = (tab, centre, "overview")[active]
    size = size_class(width, height)
    content_height = height - 3
    rectangles = arrange(size, width, content_height, LayoutRequest(view, centre, tab, rows))
    assert view in rectangles
    for rectangle in rectangles.values():
        assert rectangle.width > 0
        assert rectangle.height > 0
        assert rectangle.x + rectangle.width <= width
        assert rectangle.y + rectangle.height <= content_height
    for first, second in itertools.combinations(rectangles.values(), 2):
        assert not cells(first) & cells(second)


def map_rows(view: str, width: int) -> int:
    """A map twice as wide as high, and an instance of 20 rows; others take all."""
    return {"map": width // 4 + 4, "instance": 20}.get(view, 0)


def request(**fields: object) -> LayoutRequest:
    return LayoutRequest("map", "map", "instance", 15, **fields)  # type: ignore[arg-type]


def test_the_map_takes_the_rows_and_columns_that_it_fills():
    regions = arrange("medium", 120, 37, request(rows=map_rows))
    assert regions["map"].height == map_rows("map", regions["map"].width)
    assert regions["errors"].y == regions["map"].bottom + 1
    assert regions["errors"].bottom == 37
    regions = arrange("medium", 120, 37, request(rows=lambda view, width: 37))
    assert set(regions) == {"map", "overview", "instance"}
    assert regions["map"].height == 37
    high = arrange("medium", 120, 37, request(rows=lambda view, width: width))
    low = arrange("medium", 120, 37, request(rows=lambda view, width: width // 3))
    assert high["map"].width == 120 // 3
    assert low["map"].width > high["map"].width
    assert low["instance"].width < high["instance"].width


@pytest.mark.parametrize(("most", "rows"), [(15, 15), (14, 12), (12, 12), (11, 9), (3, 3)])
def test_the_overview_shrinks_by_whole_steps(most, rows):
    assert request(overview_step=3).fitting_overview(most) == rows


def test_a_view_is_never_placed_twice():
    wide = LayoutRequest("list", "list", "instance", 15, rows=map_rows)
    regions = arrange("wide", 200, 57, wide)
    assert regions["list"].bottom < regions["findings"].y
    assert regions["findings"].bottom == 57
