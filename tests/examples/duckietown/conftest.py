"""Rendered road images that several tests read."""

from pathlib import Path

import pytest

from examples.duckietown.conditions import CONDITIONS
from examples.duckietown.rendered_folder import write_rendered
from examples.duckietown.road_images import RoadImages, read_road_images
from tests.conftest import BuildOnce


@pytest.fixture(scope="session")
def rendered_folder(build_once: BuildOnce) -> Path:
    """Twenty-four images by day and in the dark, from two recordings each."""
    conditions = [CONDITIONS["day"], CONDITIONS["dark"]]
    return build_once("roads", lambda out: write_rendered(out, conditions, 24, seed=3))


@pytest.fixture(scope="session")
def rendered(rendered_folder: Path) -> RoadImages:
    return read_road_images(rendered_folder)
