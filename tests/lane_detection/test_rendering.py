"""Camera, road map and renderer agree with geometry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rtools.lane_detection.conditions import CONDITIONS, LightField
from s2rtools.lane_detection.fisheye_camera import FisheyeCamera
from s2rtools.lane_detection.road_map import (
    LANE_OFFSET,
    PIXELS_PER_METRE,
    TILE,
    WHITE_OFFSET,
    road_map,
)
from s2rtools.lane_detection.road_renderer import (
    RoadRenderer,
    Town,
    build_town,
    drive,
)

CAMERA = FisheyeCamera()


@pytest.fixture(scope="module")
def town() -> Town:
    return build_town(5, layout=0)


@given(st.floats(0.1, 2.0), st.floats(-1.0, 1.0))
def test_ground_points_survive_projection_and_back(x, y):
    pixel = CAMERA.to_pixels(np.array([[x, y]]))
    assert CAMERA.to_ground(pixel) == pytest.approx(np.array([[x, y]]), abs=2e-3)


def test_points_behind_the_camera_and_above_the_horizon_have_no_projection():
    assert np.isnan(CAMERA.to_pixels(np.array([[-1.0, 0.0]]))).all()
    assert np.isnan(CAMERA.to_ground(np.array([[320.0, -60.0]]))).all()


def test_projected_line_points_have_the_label_of_their_line(town):
    """From the middle of the right-hand lane of a straight road that leads to the east."""
    x, y = 1.1 * TILE, 0.5 * TILE - LANE_OFFSET
    _, mask = RoadRenderer(town).render(x, y, 0.0)
    ahead = np.linspace(0.15, 0.5, 20)
    right = np.stack([ahead, np.full(20, LANE_OFFSET - WHITE_OFFSET)], axis=1)
    middle = np.stack([ahead, np.zeros(20)], axis=1)
    for points, label in ((right, 1), (middle, 0)):
        pixels = CAMERA.to_pixels(points)
        seen = (pixels >= 0).all(axis=1) & (pixels < [CAMERA.width, CAMERA.rows]).all(axis=1)
        columns, rows = np.rint(pixels[seen]).astype(int).T
        assert seen.sum() > 5
        assert (mask[rows, columns] == label).all()


def test_dashes_cover_two_thirds_of_the_centre_line():
    road = road_map(0)
    row = round(0.5 * TILE * PIXELS_PER_METRE)
    dashes = road.coverage[row, round(TILE * 400) : round(2 * TILE * 400), 1] / 255
    assert dashes.mean() == pytest.approx(2 / 3, abs=0.03)


def test_paths_are_continuous_and_stay_on_asphalt():
    road = road_map(0)
    path = road.path(np.random.default_rng(2), 6.0)
    steps = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    assert steps.max() < 0.02
    assert np.abs(np.diff(path[:, 2])).max() < 0.12
    pixels = (path[:, :2] * PIXELS_PER_METRE).astype(int)
    assert (road.coverage[pixels[:, 1], pixels[:, 0], 3] == 255).all()


def test_a_town_without_lines_has_no_line_labels():
    for frame in drive(build_town(4, lines=False), 1, 4):
        assert not np.isin(frame.mask, (1, 2, 3)).any()


def test_lights_change_colours_in_their_direction():
    grey = np.full((40, 80, 3), 90, dtype=np.uint8)
    warm, dark, day = (
        LightField(CONDITIONS[name], (40, 80), 1).apply(grey).mean(axis=(0, 1))
        for name in ("warm", "dark", "day")
    )
    assert warm[0] > warm[1] > warm[2]
    assert dark.mean() < 0.7 * day.mean()
    assert day == pytest.approx(90, abs=15)
