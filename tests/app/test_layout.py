"""The layout of the views: inside the screen, without overlap, with the active view visible."""

from __future__ import annotations

import itertools

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
def test_views_stay_inside_the_screen_and_do_not_overlap(
    width: int, height: int, tab: str, centre: str, active: int, rows: int
) -> None:
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


def test_terminal_sizes_map_to_size_classes() -> None:
    expected = {(80, 24): "narrow", (120, 40): "medium", (200, 60): "wide", (30, 8): "tiny"}
    assert {size: size_class(*size) for size in expected} == expected
