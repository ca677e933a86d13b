"""Camera, road map and renderer agree with geometry."""

import numpy as np
import pytest

from examples.duckietown.fisheye_camera import FisheyeCamera
from examples.duckietown.road_map import LANE_OFFSET, TILE, WHITE_OFFSET
from examples.duckietown.road_renderer import RoadRenderer, Town, build_town

CAMERA = FisheyeCamera()


@pytest.fixture(scope="module")
def town() -> Town:
    return build_town(5, layout=0)


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
