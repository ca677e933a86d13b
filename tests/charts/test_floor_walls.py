"""Walls are found in floor plans, and stay whole when they are thinner than a pixel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtui.analysis.floor_walls import EMPTY, WALL, plan_parts, thin_lines

METRE = 50
"""Pixels of the plans below."""
INK = (52, 54, 58)


def plan() -> np.ndarray:
    """10 x 8 m of noisy light floor without walls."""
    random = np.random.default_rng(3)
    return random.integers(120, 220, (8 * METRE, 10 * METRE, 3), dtype=np.uint8)


def parts_of(image: np.ndarray) -> np.ndarray:
    return plan_parts(image, image.shape[1] / METRE)


def test_a_wall_is_found_and_its_door_stays_open() -> None:
    image = plan()
    image[200:208] = INK
    image[200:208, 240:290] = 160
    walls = parts_of(image)[..., WALL]
    assert walls[202:206, :238].all()
    assert not walls[190:220, 242:288].any()
    assert not walls[:198].any()


@pytest.mark.parametrize("noise", [0, 6])
def test_a_slanted_wall_is_found_in_a_compressed_image(noise: int) -> None:
    image, random = plan(), np.random.default_rng(5)
    rows, columns = np.mgrid[0 : image.shape[0], 0 : image.shape[1]]
    band = np.abs(rows - 0.6 * columns - 40) < 6
    image[band] = np.clip(random.integers(-noise, noise + 1, (band.sum(), 3)) + INK, 0, 255)
    walls = parts_of(image)[..., WALL].astype(bool)
    inner = np.abs(rows - 0.6 * columns - 40) < 3
    assert walls[inner].mean() > 0.97
    assert walls[~band].mean() < 0.005


def test_dark_furniture_away_from_walls_is_no_wall() -> None:
    image = plan()
    image[:, :8] = INK
    image[200:206, 250:270] = INK
    walls = parts_of(image)[..., WALL]
    assert walls[:, 2:6].all()
    assert not walls[190:216, 240:280].any()


def test_the_surroundings_of_a_building_are_empty_and_have_a_wall_along_their_edge() -> None:
    image = plan()
    image[:, 300:] = INK
    parts = parts_of(image)
    assert parts[:, 302:305, WALL].all()
    assert parts[:, 312:, EMPTY].all()
    assert not parts[..., EMPTY].astype(bool)[:, :300].any()


def test_a_stripe_in_an_empty_area_is_empty() -> None:
    image = plan()
    image[:, 200:] = INK
    image[150:154, 200:] = 200
    assert parts_of(image)[140:165, 212:490, EMPTY].all()


@pytest.mark.parametrize("colour", [None, (230, 230, 230)])
def test_a_plan_without_a_dark_colour_of_its_own_has_no_walls(
    colour: tuple[int, ...] | None,
) -> None:
    image = plan()
    if colour is not None:
        image[:] = colour
    assert not parts_of(image).any()


@given(start=st.floats(0, 5), width=st.floats(0.2, 0.99), upright=st.booleans())
def test_a_line_thinner_than_a_pixel_is_drawn_one_pixel_wide(
    start: float, width: float, upright: bool
) -> None:
    edges = np.arange(9)
    covered = np.clip(np.minimum(edges[1:], start + width) - np.maximum(edges[:-1], start), 0, 1)
    drawn = thin_lines(np.repeat(covered[:, None], 6, axis=1).T if upright else
                       np.repeat(covered[:, None], 6, axis=1))  # fmt: skip
    drawn = drawn.T if upright else drawn
    assert (drawn == drawn[:, :1]).all()
    assert drawn[:, 0].sum() == 1
    assert covered[drawn[:, 0]].max() == covered.max()
