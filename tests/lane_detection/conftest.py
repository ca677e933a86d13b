"""Rendered road images that several tests read."""

from pathlib import Path

import pytest

from s2rtools.lane_detection.conditions import CONDITIONS
from s2rtools.lane_detection.rendered_folder import write_rendered
from s2rtools.lane_detection.road_images import RoadImages, read_road_images
from tests.conftest import BuildOnce


@pytest.fixture(scope="session")
def rendered_folder(build_once: BuildOnce) -> Path:
    """Twenty-four images by day and in the dark, from two recordings each."""
    conditions = [CONDITIONS["day"], CONDITIONS["dark"]]
    return build_once("roads", lambda out: write_rendered(out, conditions, 24, seed=3))


@pytest.fixture(scope="session")
def rendered(rendered_folder: Path) -> RoadImages:
    return read_road_images(rendered_folder)
