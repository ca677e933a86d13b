"""Panels of the views: conversion of cells to data, position inside the view and no overlap."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.records import Bounds
from s2rtui.canvas import RenderOptions
from s2rtui.canvas.marks import PlotArea
from s2rtui.charts.compare.terminal import compare_panels
from s2rtui.charts.map.terminal import map_panels
from s2rtui.drawing.cells import drawing_panels
from s2rtui.drawing.drawing import Drawing
from tests.charts.examples import (
    compare_input,
    counts_drawing,
    errors_drawing,
    findings_of,
    groups_drawing,
    list_drawing,
    map_input,
    orientation_drawing,
    overview_drawing,
    overview_lines,
    scatter_of,
    umap_drawing,
)

Surface = Callable[[tuple[int, int], RenderOptions], tuple[PlotArea, ...]]
NEAR = Bounds(3.0, 2.0, 6.0, 4.0)


def surface(panels: Callable[..., tuple[PlotArea, ...]], data: object, *area: Bounds) -> Surface:
    return lambda size, options: panels(data, size, options, *area)


def drawn(drawing: Drawing) -> Surface:
    return lambda size, options: drawing_panels(drawing, size, options)


SIDES, DIALS = ("sim", "real"), ("sim", "truth", "real")
RUNS = ("vanilla", "dataaug", "seen all")
VIEWS: dict[str, tuple[Surface, str, tuple[str, ...]]] = {
    "map": (surface(map_panels, map_input(y_down=False)), "plane", ("map",)),
    "near comparison": (surface(compare_panels, compare_input(), NEAR), "plane", ("map",)),
    "umap": (drawn(umap_drawing()), "plane", SIDES),
    "orientation": (drawn(orientation_drawing()), "turn", DIALS),
    "upwards": (drawn(orientation_drawing(y_down=False)), "turn", DIALS),
    "scatter": (drawn(scatter_of()), "plane", ("errors",)),
    "rooms": (drawn(counts_drawing()), "steps", DIALS),
    "groups": (drawn(groups_drawing()), "steps", ("groups",)),
    "list": (drawn(list_drawing(7)), "steps", ("rows",)),
    "findings": (drawn(findings_of()), "steps", ("findings",)),
    "errors": (drawn(errors_drawing()), "range", SIDES),
    "overview": (drawn(overview_drawing()), "range", RUNS),
    "overview lines": (drawn(overview_drawing(overview_lines())), "range", RUNS),
}


@pytest.mark.parametrize("name", VIEWS)
@given(
    width=st.integers(1, 200),
    height=st.integers(1, 60),
    ascii=st.booleans(),
    across=st.floats(0, 0.999),
    down=st.floats(0, 0.999),
)
def test_cells_convert_to_data_and_back(name, width, height, ascii, across, down):
    panels_of, shape, names = VIEWS[name]
    panels = panels_of((width, height), RenderOptions(ascii=ascii))
    assert tuple(panel.name for panel in panels) == names[: len(panels)]
    for panel in panels:
        assert panel.shape == shape
        column = panel.x + int(across * panel.width)
        row = panel.y + int(down * panel.height)
        assert panel.holds(column, row)
        data = panel.to_data(column + 0.5, row + 0.5)
        cell = panel.to_cells(*data)
        assert panel.to_data(*cell) == pytest.approx(data)
        assert int(np.floor(cell[0] + 1e-9)) == column
        if shape != "steps":
            assert int(np.floor(cell[1] + 1e-9)) == row


@pytest.mark.parametrize("name", VIEWS)
@given(width=st.integers(1, 120), height=st.integers(1, 40))
def test_panels_stay_inside_the_view_and_do_not_overlap(name, width, height):
    coverage = np.zeros((height, width), dtype=np.intp)
    for panel in VIEWS[name][0]((width, height), RenderOptions()):
        assert panel.x + panel.width <= width
        assert panel.y + panel.height <= height
        coverage[panel.y : panel.y + panel.height, panel.x : panel.x + panel.width] += 1
    assert coverage.max() <= 1


@pytest.mark.parametrize("name", VIEWS)
def test_all_panels_are_present_at_common_sizes(name):
    panels_of, _, names = VIEWS[name]
    for size in ((50, 9), (50, 10), (80, 22), (200, 56)):
        assert tuple(panel.name for panel in panels_of(size, RenderOptions())) == names
