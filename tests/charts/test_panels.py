"""Panels of the views: conversion of cells to data, position inside the view and no overlap."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.records import Bounds
from s2rtui.canvas import RenderOptions
from s2rtui.charts.compare import compare_drawing
from s2rtui.charts.map import map_drawing
from s2rtui.drawing.cells import drawing_panels
from s2rtui.drawing.drawing import Drawing
from tests.charts.examples import DRAWINGS, compare_input, map_input, orientation_drawing

NEAR = Bounds(3.0, 2.0, 6.0, 4.0)
SIDES, DIALS = ("sim", "real"), ("sim", "truth", "real")
RUNS = ("vanilla", "dataaug", "seen all")
PANELS: dict[str, tuple[str, tuple[str, ...]]] = {
    "umap": ("plane", SIDES), "scatter": ("plane", ("errors",)), "orientation": ("turn", DIALS),
    "rooms": ("steps", DIALS), "groups": ("steps", ("groups",)), "list": ("steps", ("rows",)),
    "findings": ("steps", ("findings",)), "errors": ("range", SIDES), "overview": ("range", RUNS),
    "overview lines": ("range", RUNS),
}  # fmt: skip
VIEWS: dict[str, tuple[Drawing, str, tuple[str, ...]]] = {
    "map": (map_drawing(map_input(y_down=False)), "plane", ("map",)),
    "near comparison": (compare_drawing(compare_input(), NEAR), "plane", ("map",)),
    "upwards": (orientation_drawing(y_down=False), "turn", DIALS),
    **{name: (DRAWINGS[name], *panels) for name, panels in PANELS.items()},
}
"""Drawings, and the shape and the names of their panels."""


@pytest.mark.parametrize("name", VIEWS)
@given(
    width=st.integers(1, 200),
    height=st.integers(1, 60),
    ascii=st.booleans(),
    across=st.floats(0, 0.999),
    down=st.floats(0, 0.999),
)
def test_cells_convert_to_data_and_back(name, width, height, ascii, across, down):
    drawing, shape, names = VIEWS[name]
    panels = drawing_panels(drawing, (width, height), RenderOptions(ascii=ascii))
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
    for panel in drawing_panels(VIEWS[name][0], (width, height), RenderOptions()):
        assert panel.x + panel.width <= width
        assert panel.y + panel.height <= height
        coverage[panel.y : panel.y + panel.height, panel.x : panel.x + panel.width] += 1
    assert coverage.max() <= 1


@pytest.mark.parametrize("name", VIEWS)
def test_all_panels_are_present_at_common_sizes(name):
    drawing, _, names = VIEWS[name]
    for size in ((50, 9), (50, 10), (80, 22), (200, 56)):
        assert tuple(panel.name for panel in drawing_panels(drawing, size)) == names
