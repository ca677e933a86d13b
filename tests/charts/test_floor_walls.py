"""Walls are found in floor plans, stay whole when thin, and are drawn without colours."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtui.analysis.floor_walls import EMPTY, WALL, plan_parts, thin_lines
from s2rtui.canvas import DIGITS, ColourMode, RenderOptions
from s2rtui.charts.map import map_drawing
from s2rtui.drawing.floor import FLOOR_RAMPS, WALL_LINES, wall_lines
from s2rtui.drawing.heat_colours import heat_glyphs
from tests.charts.examples import BOUNDS, draw_map, map_input, map_place

METRE = 50
"""Pixels of the plans below."""
INK = (52, 54, 58)


def plan() -> np.ndarray:
    """10 x 8 m of noisy light floor without walls."""
    random = np.random.default_rng(3)
    return random.integers(120, 220, (8 * METRE, 10 * METRE, 3), dtype=np.uint8)


def parts_of(image: np.ndarray) -> np.ndarray:
    return plan_parts(image, image.shape[1] / METRE)


def test_a_wall_is_found_and_its_door_stays_open():
    image = plan()
    image[200:208] = INK
    image[200:208, 240:290] = 160
    walls = parts_of(image)[..., WALL]
    assert walls[202:206, :238].all()
    assert not walls[190:220, 242:288].any()
    assert not walls[:198].any()


@pytest.mark.parametrize("noise", [0, 6])
def test_a_slanted_wall_is_found_in_a_compressed_image(noise):
    image, random = plan(), np.random.default_rng(5)
    rows, columns = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
    band = np.abs(rows - 0.6 * columns - 40) < 6
    image[band] = np.clip(random.integers(-noise, noise + 1, (band.sum(), 3)) + INK, 0, 255)
    walls = parts_of(image)[..., WALL].astype(bool)
    inner = np.abs(rows - 0.6 * columns - 40) < 3
    assert walls[inner].mean() > 0.97
    assert walls[~band].mean() < 0.005


def test_dark_furniture_away_from_walls_is_no_wall():
    image = plan()
    image[:, :8] = INK
    image[200:206, 250:270] = INK
    walls = parts_of(image)[..., WALL]
    assert walls[:, 2:6].all()
    assert not walls[190:216, 240:280].any()


def test_the_surroundings_of_a_building_are_empty_and_have_a_wall_along_their_edge():
    image = plan()
    image[:, 300:] = INK
    parts = parts_of(image)
    assert parts[:, 302:305, WALL].all()
    assert parts[:, 312:, EMPTY].all()
    assert not parts[..., EMPTY].astype(bool)[:, :300].any()


def test_a_stripe_in_an_empty_area_is_empty():
    image = plan()
    image[:, 200:] = INK
    image[150:154, 200:] = 200
    assert parts_of(image)[140:165, 212:490, EMPTY].all()


def test_a_plan_without_a_dark_colour_of_its_own_has_no_walls():
    assert not parts_of(plan()).any()
    assert not parts_of(np.full_like(plan(), 230)).any()


@given(start=st.floats(0, 5), width=st.floats(0.2, 0.99), upright=st.booleans())
def test_a_line_thinner_than_a_pixel_is_drawn_one_pixel_wide(start, width, upright):
    edges = np.arange(9)
    covered = np.clip(np.minimum(edges[1:], start + width) - np.maximum(edges[:-1], start), 0, 1)
    shares = np.repeat(covered[:, None], 6, axis=1)
    drawn = thin_lines(shares.T).T if upright else thin_lines(shares)
    assert (drawn == drawn[:, :1]).all()
    assert drawn[:, 0].sum() == 1
    assert covered[drawn[:, 0]].max() == covered.max()


MAP_SIZE = (83, 30)
MODES = [
    RenderOptions(mode=ColourMode.NONE),
    RenderOptions(ascii=True),
    RenderOptions(mode=ColourMode.NONE, ascii=True),
]


def plain_walls() -> np.ndarray:
    """20 x 10 m of light floor with walls of 20 cm at x = 10.1 m and, right of it, at y = 5.2 m."""
    image = np.full((500, 1000, 3), 225, dtype=np.uint8)
    image[:, 501:511] = 20
    image[257:267, 511:] = 20
    return image


@pytest.mark.parametrize("options", MODES)
@pytest.mark.parametrize("with_heat", [False, True])
def test_walls_have_characters_of_their_own(options, with_heat):
    heat = np.tile(np.linspace(0.0, 2.0, 100), (50, 1)) if with_heat else None
    nobody = np.zeros(60, dtype=np.bool_)
    view = map_input(
        plan=plain_walls(), heat=heat, rooms=(), cursor=None, selected=nobody, valid=nobody,
        bounds=BOUNDS,
    )  # fmt: skip
    canvas = draw_map(view, MAP_SIZE, options)
    place = map_place(map_drawing(view), MAP_SIZE, options)

    def drawn(points: list[tuple[float, float]]) -> set[str]:
        return {str(canvas.char[cell]) for cell in place.cells(points)}

    heights = np.arange(0.5, 9.6, 0.25)
    upright = drawn([(10.12, y) for y in heights])
    level = drawn([(x, 5.24) for x in np.arange(11.0, 19.0, 0.25)])
    floor = drawn([(x, y) for x in (3.0, 7.0, 14.0, 17.0) for y in (1.5, 3.0, 7.5, 9.0)])
    lines = set(WALL_LINES[options.ascii])
    others = FLOOR_RAMPS[options.ascii] + DIGITS
    others += heat_glyphs(options, False) + heat_glyphs(options, True)
    assert upright <= lines
    assert level <= lines
    assert upright & level <= {"╠"}, "lines show in which direction a wall runs"
    assert not floor & lines
    assert not lines & set(others)


def test_lines_join_neighbouring_walls():
    walls = np.array([[1, 1, 1, 0], [1, 0, 1, 1], [1, 1, 1, 0], [0, 0, 0, 1]], dtype=np.bool_)
    lines, held = wall_lines(walls, ascii=False)
    drawn = ["".join(row) for row in np.where(held, lines, " ").tolist()]
    assert drawn == ["╔═╗ ", "║ ╠═", "╚═╝ ", "   ╬"]
    plain, _ = wall_lines(walls, ascii=True)
    assert ["".join(row) for row in np.where(held, plain, " ").tolist()] == [
        "|_| ", "| |_", "|_| ", "   _",
    ]  # fmt: skip
