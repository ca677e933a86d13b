"""Rendered road images that several tests read."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rtools.lane_detection.conditions import CONDITIONS
from s2rtools.lane_detection.rendered_folder import write_rendered
from s2rtools.lane_detection.road_images import RoadImages, read_road_images


@pytest.fixture(scope="session")
def rendered_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twenty-four images by day and in the dark, from two recordings each."""
    out = tmp_path_factory.mktemp("roads") / "rendered"
    write_rendered(out, [CONDITIONS["day"], CONDITIONS["dark"]], 24, seed=3)
    return out


@pytest.fixture(scope="session")
def rendered(rendered_folder: Path) -> RoadImages:
    return read_road_images(rendered_folder)
