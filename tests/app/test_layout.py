"""Where the views stand: inside the screen, apart from each other, the active one seen."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st
from textual.geometry import Region

from s2rtui.app.layout import MIN_SIZE, LayoutRequest, arrange, size_class
from s2rtui.charts.registry import VIEWS

TABS = [view.name for view in VIEWS if view.pane == "tab"]
CENTRES = [view.name for view in VIEWS if view.pane == "centre"]


def cells(place: Region) -> set[tuple[int, int]]:
    return {
        (x, y)
        for x in range(place.x, place.x + place.width)
        for y in range(place.y, place.y + place.height)
    }


@given(
    width=st.integers(MIN_SIZE[0], 260),
    height=st.integers(MIN_SIZE[1], 80),
    tab=st.sampled_from(TABS),
    centre=st.sampled_from(CENTRES),
    active=st.integers(0, 2),
    rows=st.integers(3, 30),
)
def test_views_fill_their_places(
    width: int, height: int, tab: str, centre: str, active: int, rows: int
) -> None:
    view = (tab, centre, "overview")[active]
    size = size_class(width, height)
    inner = height - 3
    places = arrange(size, width, inner, LayoutRequest(view, centre, tab, rows))
    assert view in places
    for place in places.values():
        assert place.width > 0
        assert place.height > 0
        assert place.x + place.width <= width
        assert place.y + place.height <= inner
    for one, two in itertools.combinations(places.values(), 2):
        assert not cells(one) & cells(two)


def test_sizes_have_classes() -> None:
    expected = {(80, 24): "narrow", (120, 40): "medium", (200, 60): "wide", (30, 8): "tiny"}
    assert {size: size_class(*size) for size in expected} == expected
