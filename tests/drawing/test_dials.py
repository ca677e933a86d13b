"""Dials: directions and lengths of bars, strips where there is no room, brushes and pictures."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from s2rtui.canvas import DARK, ColourMode, RenderOptions
from s2rtui.canvas.marks import BrushShape, mark_arc, wrap_degrees
from s2rtui.drawing.cells import draw_cells, drawing_panels
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Bars, Phrase, Plot
from s2rtui.drawing.plot_cells import bar_dots, dial_of
from s2rtui.drawing.scale import Scale

EDGES = np.linspace(-180, 180, 73)
NAMES = ("sim", "truth", "real")
X = Scale(-180.0, 180.0, fixed=tuple((at, str(at)) for at in (-180, -90, 0, 90, 180)))
Y = Scale(0.0, 9.0, ("max 9",))


def dials(
    degrees: float = 0.0, clockwise: bool = True, selected: int = 9, bins: int = 72
) -> Drawing:
    """Three dials with one bar each, of 9 in the bin of some degrees."""
    edges = np.linspace(-180, 180, bins + 1)
    counts, _ = np.histogram([degrees] * 9, edges)
    plots = tuple(
        Plot(X, Y, (Bars(edges, counts * selected // 9, counts, name),), name,
             (Phrase(name, name, name), Phrase("mean")), shape="turn",
             turns="clockwise" if clockwise else "anticlockwise")
        for name in NAMES
    )  # fmt: skip
    return Drawing(plots, beside=True)


@pytest.mark.parametrize(
    ("degrees", "clockwise", "direction"),
    [(2, True, "right"), (92, True, "down"), (92, False, "up"), (-88, True, "up"),
     (178, True, "left")],
)  # fmt: skip
@pytest.mark.parametrize("options", [RenderOptions(), RenderOptions(ascii=True)])
def test_bars_have_their_direction(degrees, clockwise, direction, options):
    size, view = (120, 24), dials(degrees, clockwise=clockwise)
    canvas = draw_cells(view, size, options)
    panels = drawing_panels(view, size, options)
    for panel, colour in zip(panels, (DARK.sim, DARK.truth, DARK.real), strict=True):
        rows, columns = (slice(panel.y, panel.y + panel.height),
                         slice(panel.x, panel.x + panel.width))  # fmt: skip
        inked = (canvas.fg[rows, columns] == colour).all(axis=-1)
        inked &= canvas.char[rows, columns] != " "
        row, column = (part.mean() for part in np.nonzero(inked))
        across, down = column + 0.5 - panel.width / 2, 2 * (row + 0.5 - panel.height / 2)
        offsets = {"right": across, "left": -across, "down": down, "up": -down}
        assert max(offsets, key=lambda name: offsets[name]) == direction
        assert offsets[direction] > 3


@given(arrays.arrays(np.float64, 72, elements=st.sampled_from([0.0, 0.01, 0.3, 1.0])))
def test_bar_lengths_are_proportional_to_counts(lengths):
    dial = dial_of(dials().plots[0], 40, 10)
    dots = bar_dots(dial, 40, 10, EDGES, lengths)
    rows, columns = np.nonzero(dots)
    data_points = [
        dial.to_data((column + 0.5) / 2, (row + 0.5) / 4)
        for row, column in zip(rows.tolist(), columns.tolist(), strict=True)
    ]
    turns = np.array([data_point[0] for data_point in data_points])
    radii = np.array([data_point[1] for data_point in data_points])
    dot = 0.75 / (dial.rim - dial.ring)
    for index in np.flatnonzero(lengths > 0):
        bin_centre = (index + 0.5) * 5 - 180
        near = np.abs((turns - bin_centre + 180) % 360 - 180) < 5
        assert radii[near].max() > lengths[index] - dot
    assert (radii > -dot).all()
    if not (lengths > 0).any():
        assert not dots.any()
    elif lengths.max() < 1:
        assert radii.max() < lengths.max() + dot + 0.5 / (dial.rim - dial.ring)


def test_bars_of_any_edges_lie_between_them():
    dial = dial_of(dials().plots[0], 40, 20)
    dots = bar_dots(dial, 40, 20, np.array([150.0, 170.0, 220.0]), np.array([0.0, 1.0]))
    turns = [dial.to_data((column + 0.5) / 2, (row + 0.5) / 4)[0]
             for row, column in np.argwhere(dots)]  # fmt: skip
    assert min(turn % 360 for turn in turns) > 169
    assert 210 < max(turn % 360 for turn in turns) < 221


@pytest.mark.parametrize("size", [(50, 4), (40, 3), (80, 5)])
def test_small_sizes_use_strips_instead_of_dials(size):
    view = dials(92, bins=24)
    canvas = draw_cells(view, size)
    for panel in drawing_panels(view, size):
        row = canvas.char[panel.y + panel.height - 1, panel.x : panel.x + panel.width]
        filled = np.flatnonzero(row == "█")
        assert abs(filled.size - panel.width / 24) <= 1
        degrees = [panel.to_data(panel.x + offset + 0.5, panel.y + 0.5)[0] for offset in filled]
        assert all(90 <= turn <= 105 for turn in degrees)


def test_selected_and_others_differ_without_colours():
    for options, highlighted in (
        (RenderOptions(mode=ColourMode.NONE), "▀▄█▌▐▘▝▖▗▛▜▙▟"),
        (RenderOptions(ascii=True), "#"),
    ):
        drawn, grey = (
            "".join(draw_cells(dials(10, selected=selected), (120, 24), options).lines()[4:])
            for selected in (9, 0)
        )
        assert any(glyph in drawn for glyph in highlighted)
        assert not any(glyph in grey for glyph in highlighted)
        assert "".join(grey.split()) != ""


@pytest.mark.parametrize(
    ("ends", "arc"),
    [((30.0, 50.0), (40.0, 10.0)), ((170.0, -160.0), (-175.0, 15.0)),
     ((160.0, 200.0), (180.0, 20.0)), ((-20.0, 240.0), (110.0, 130.0)),
     ((50.0, 30.0), (-140.0, 170.0)), ((-200.0, 200.0), (-20.0, 180.0))],
)  # fmt: skip
def test_a_brush_covers_the_arc_from_its_first_to_its_last_end(ends, arc):
    centre, half = mark_arc(BrushShape("sim", ((ends[0], 1.0), (ends[1], 1.0))))
    assert wrap_degrees(centre - arc[0]) == pytest.approx(0)
    assert half == pytest.approx(arc[1])


def test_terminals_with_graphics_get_discs_beside_which_the_labels_stay():
    for size in ((120, 24), (40, 40), (96, 20), (75, 40)):
        canvas = draw_cells(dials(92), size)
        assert len(canvas.images) == 3
        for image in canvas.images:
            canvas.char[image.y : image.y + image.height, image.x : image.x + image.width] = " "
        labels = "".join(canvas.lines()).replace("max 9", "").split()
        assert labels.count("-90") == labels.count("180") == labels.count("0") == 3
    image = draw_cells(dials(92), (120, 24)).images[0]
    pixels = image.pixels((16 * image.height, 8 * image.width)).astype(int)
    inked = np.argwhere(np.abs(pixels - DARK.sim).max(axis=-1) <= 3)
    row, column = inked.mean(axis=0)
    assert row > 0.6 * pixels.shape[0]
    assert abs(column / pixels.shape[1] - 0.5) < 0.1
