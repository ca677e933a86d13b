"""Images as marks of plots: their layout, values over them, and what stands in their place."""

import numpy as np
import pytest

from s2rtui.canvas import DEFAULT_OPTIONS, LIGHT, ColourMode, RenderOptions
from s2rtui.canvas.colour import NO_DEPTH
from s2rtui.drawing import paper
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.drawing_layout import drawing_layout
from s2rtui.drawing.heat_colours import heat_colours, ramp_colours
from s2rtui.drawing.image import Image, ImageValues
from s2rtui.drawing.paper import draw_paper
from s2rtui.drawing.plot import Phrase, Plot
from s2rtui.drawing.scale import Scale
from s2rtui.drawing.table import Cell, Column, Row, TableSpec

PIXELS = np.random.default_rng(1).integers(0, 256, (24, 32, 3), dtype=np.uint8)
METRES = np.linspace(0.5, 8, 24 * 32).reshape(24, 32)
HEAT = ImageValues(np.linspace(-1, 1, 36).reshape(6, 6), (-1.0, 1.0), "signed overlay", "heat")
DEPTH = ImageValues(METRES, (0.0, 8.0), "depth")
NO_COLOURS = [RenderOptions(ascii=True), RenderOptions(mode=ColourMode.NONE)]


def plot(image: Image, row: str, name: str) -> Plot:
    y = Scale(24.0, 0.0, (row,))
    return Plot(Scale(0.0, 32.0), y, (image,), title=(Phrase(name, "sim", "sim"),))


def drawing(**fields: object) -> Drawing:
    plots = (
        plot(Image(PIXELS, HEAT), "image", "first"), plot(Image(PIXELS, HEAT), "image", "second"),
        plot(Image(DEPTH), "depth", "depth"),
        plot(Image(None, missing="no depth"), "depth", "depth"),
    )  # fmt: skip
    bars = (
        ColourBar("heat", "m", (-1.0, 1.0), ramp="signed overlay"),
        ColourBar("depth", "m", (0.0, 8.0), ramp="depth"),
    )
    table = TableSpec((Column(""), Column("x m", right=True)),
                      (Row((Cell("truth"), Cell("1.25")), sign="truth"),))  # fmt: skip
    shown = {"plots": plots, "table": table, "notes": (bars, "where here", "ranks 1 of 9")}
    return Drawing(**shown | fields)  # type: ignore[arg-type]


@pytest.mark.parametrize("options", [DEFAULT_OPTIONS, NO_COLOURS[0]])
@pytest.mark.parametrize("size", [(36, 38), (60, 50), (80, 22), (150, 30)])
def test_images_fit_keep_their_shape_and_stand_beside_each_other(size, options):
    places = drawing_layout(drawing(), size, options).plots
    assert len(places) == (4 if options.supports_images else 6) or size[1] < 30
    for place in places:
        assert place.left + place.width <= size[0]
        assert place.top + place.rows <= size[1]
        assert place.width / place.rows == pytest.approx(2 * 32 / 24, rel=0.35)
    for first, second in zip(places[::2], places[1::2], strict=True):
        assert first.top == second.top
        assert first.left + first.width <= second.left


def test_without_room_for_all_rows_the_first_is_left():
    shown = drawing_layout(drawing(), (30, 10), DEFAULT_OPTIONS).plots
    assert {place.plot.y.names[0] for place in shown} == {"image"}


@pytest.mark.parametrize("options", [DEFAULT_OPTIONS, *NO_COLOURS])
@pytest.mark.parametrize("overlay", [None, HEAT])
def test_an_absent_image_has_its_reason_in_its_place(options, overlay):
    absent = plot(Image(None, overlay, "no image"), "image", "first")
    text = "\n".join(draw_cells(Drawing((absent,)), (60, 40), options).lines())
    assert text.count("no image") == 1


def test_a_label_stays_a_text_over_true_pixels():
    labelled = plot(Image(PIXELS, label="original"), "image", "first")
    (image,) = draw_cells(Drawing((labelled,)), (40, 20)).images
    assert image.text is not None
    assert image.text[0].sum() == len(" original ")
    assert not image.text[1:].any()


@pytest.mark.parametrize("options", NO_COLOURS)
def test_values_are_digits_and_letters_beside_the_image_without_colours(options):
    canvas, layout = (
        each(drawing(), (60, 60), options) for each in (draw_cells, drawing_layout)
    )  # fmt: skip
    alone = [place for place in layout.plots if place.plot.image.ground is None]
    digits, _, _ = alone
    part = canvas.char[digits.top : digits.top + digits.rows, digits.left :][:, : digits.width]
    assert set(part.ravel()) <= set("ihgfedcba.123456789")
    assert {"i", ".", "9"} <= set(part.ravel())


def test_values_without_a_number_and_zero_are_transparent():
    _, opacity = heat_colours(np.array([[0.0, 1.0, np.nan]]), (-1.0, 1.0), signed=True)
    assert opacity[0, [0, 2]].tolist() == [0, 0]
    assert opacity[0, 1] > 0.7
    nothing = ImageValues(np.full((2, 2), np.nan), (-1.0, 1.0), "signed overlay")
    assert (Image(PIXELS, nothing).pixels((24, 32)) == PIXELS).all()


def test_unknown_depth_has_a_colour_of_its_own():
    metres = METRES.copy()
    metres[:4] = np.nan
    pixels = Image(ImageValues(metres, (0.0, 8.0), "depth")).pixels((24, 32))
    assert (pixels[:4] == NO_DEPTH).all()
    assert not (pixels[4:] == NO_DEPTH).all(axis=-1).any()


def test_the_scale_of_signed_values_is_neutral_in_the_middle():
    colours = ramp_colours("signed overlay")
    assert np.ptp(colours([0.5])) == 0
    assert np.ptp(colours([0.9])) > 80


@pytest.mark.parametrize("size", [(900, 700), (400, 900)])
def test_a_page_has_bars_beside_or_below_the_images(size, monkeypatch):
    drawn = []
    bar = paper.draw_colour_bar
    monkeypatch.setattr(paper, "draw_colour_bar", lambda *all: (drawn.append(all[1]), bar(*all)))
    draw_paper(drawing(), size, LIGHT, "a title")
    (left, low, _, _), (other, *_) = drawn
    assert left < other
    assert (left > 2) == (size[0] == 900)
    assert low > 0
