"""Floor plans that are placed by known points or by a ROS occupancy grid fill the bounds."""

import math
from dataclasses import astuple
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.records import Bounds
from s2rtools.datasets.floor.floor_plans import (
    OUTSIDE,
    PlacedPlan,
    fit_similarity,
    occupancy_grid,
)
from tests.datasets.helpers import scan_of
from tests.support import pairs
from tests.support.refusals import refused

GRID = """# a map
image: map.pgm
resolution: 0.05
origin: [-2.0, -1.0, {yaw}]
negate: {negate}
occupied_thresh: 0.65
free_thresh: 0.196
"""


def write_grid(
    folder: Path, pixels: NDArray[np.uint8], yaw: float = 0.0, negate: int = 0, more: str = ""
) -> Path:
    cv2.imwrite(str(folder / "map.pgm"), pixels)
    (folder / "map.yaml").write_text(GRID.format(yaw=yaw, negate=negate) + more)
    return folder / "map.yaml"


def read_grid(path: Path) -> PlacedPlan:
    return occupancy_grid(path, lambda name: path.parent / name)


def colour_at(image: NDArray[np.uint8], bounds: Bounds, y_down: bool, x: float, y: float) -> int:
    height, width = image.shape[:2]
    away = y - bounds.y0 if y_down else bounds.y1 - y
    row, col = away / bounds.height * height, (x - bounds.x0) / bounds.width * width
    return int(image[int(row), int(col), 0])


@given(
    st.floats(-math.pi, math.pi), st.floats(0.005, 0.2), st.floats(-50, 50), st.floats(-50, 50),
    st.booleans(), st.integers(2, 5), st.integers(0, 99),
)  # fmt: skip
def test_similarity_maps_known_points(turn, scale, x, y, y_down, count, seed):
    pixels = np.random.default_rng(seed).uniform(0, 800, (count, 2))
    v = pixels[:, 1] * (1 if y_down else -1)
    cos, sin = scale * math.cos(turn), scale * math.sin(turn)
    metres = np.stack([cos * pixels[:, 0] - sin * v + x, sin * pixels[:, 0] + cos * v + y], 1)
    fitted = fit_similarity(pixels, metres, y_down, "plan")
    assert np.column_stack([pixels, np.ones(count)]) @ fitted.T == pytest.approx(metres, abs=1e-6)


def test_points_that_do_not_fit_are_refused():
    pixels = np.array([[0.0, 0.0], [100, 0], [0, 100]])
    metres = np.array([[0.0, 0.0], [5, 0], [0, 5]])
    fit_similarity(pixels, metres, True, "plan")
    with pytest.raises(RequestError, match=r"plan: the points miss .* y_down"):
        fit_similarity(pixels, metres, False, "plan")
    with pytest.raises(RequestError, match="coincide"):
        fit_similarity(pixels[[0, 0]], metres[:2], True, "plan")


@pytest.mark.parametrize("yaw", [0.0, 0.5, -2.0])
@pytest.mark.parametrize("y_down", [False, True])
def test_occupancy_grid_lies_at_its_origin(tmp_path, yaw, y_down):
    pixels = np.full((80, 120), 254, np.uint8)
    pixels[10:20, 30:50] = 0  # x 1.5 .. 2.5, y 3.0 .. 3.5 from the lower left corner
    placed = read_grid(write_grid(tmp_path, pixels, yaw))
    bounds = placed.bounds
    image = placed.resampled(bounds, y_down)
    for x, y, occupied in ((2.0, 3.25, True), (2.0, 2.75, False), (2.8, 3.25, False)):
        at_x = -2.0 + math.cos(yaw) * x - math.sin(yaw) * y
        at_y = -1.0 + math.sin(yaw) * x + math.cos(yaw) * y
        assert (colour_at(image, bounds, y_down, at_x, at_y) < 100) == occupied


def test_cells_of_a_grid_are_occupied_free_or_unknown(tmp_path):
    pixels = np.repeat(np.array([[0, 205, 254]], np.uint8), 3, 0)
    assert read_grid(write_grid(tmp_path, pixels)).image[0, :, 0].tolist() == [40, 205, 254]
    negated = read_grid(write_grid(tmp_path, 255 - pixels, negate=1))
    assert negated.image[0, :, 0].tolist() == [40, 205, 254]
    scaled = read_grid(write_grid(tmp_path, np.full((3, 3), 128, np.uint8), more="mode: scale\n"))
    assert 130 < scaled.image[0, 0, 0] < 160


def test_large_plans_are_averaged(tmp_path):
    pixels = (np.indices((3000, 3000)).sum(axis=0) % 2 * 254).astype(np.uint8)
    pixels[:, :1500] = 254
    placed = PlacedPlan(cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB), np.eye(3)[:2] * 0.01)
    image = placed.resampled(placed.bounds, True)
    assert image.shape == (1056, 1056, 3)
    assert image[500, 100, 0] == 254
    assert abs(int(image[500, 800, 0]) - 127) < 20


def header_of(folder: Path, plan: str, bounds: bool = True) -> Path:
    """A CSV manifest whose configuration has a floor plan."""
    path = pairs.manifest(folder, n=2)
    text = pairs.HEADER
    if not bounds:
        text = text.replace("[bounds]\nx0 = 0.0\ny0 = 0.0\nx1 = 8.0\ny1 = 6.0\n", "")
    path.with_suffix(".toml").write_text(plan + "\n" + text if "[" not in plan else text + plan)
    return path


TABLE = '[floor_plan]\nimage = "plan.png"\npoints = [[0, 0, 0, 0], [120, 80, 6.0, 4.0]]\n'


@pytest.mark.parametrize("plan", ['floor_plan = "map.yaml"', TABLE])
def test_placed_plan_of_a_configuration_fills_its_bounds_or_defines_them(tmp_path, plan):
    path = header_of(tmp_path, plan)
    pixels = np.full((80, 120), 254, np.uint8)
    write_grid(tmp_path, pixels)
    cv2.imwrite(str(tmp_path / "plan.png"), pixels)
    scan = scan_of("csv", path)
    assert scan.bounds == Bounds(0.0, 0.0, 8.0, 6.0)
    assert isinstance(scan.floor_plan, np.ndarray)
    assert scan.floor_plan.shape == (792, 1056, 3)
    assert colour_at(scan.floor_plan, scan.bounds, scan.y_down, 7.0, 5.0) == OUTSIDE[0]
    header_of(tmp_path, plan, bounds=False)
    own = Bounds(-2.0, -1.0, 4.0, 3.0) if "yaml" in plan else Bounds(0.0, 0.0, 6.0, 4.0)
    assert astuple(scan_of("csv", path).bounds) == pytest.approx(astuple(own))


@pytest.mark.parametrize(
    ("plan", "message"),
    [('floor_plan = "none.yaml"', r"none\.yaml"),
     ('floor_plan = "../map.yaml"', r"floor_plan: '\.\./map\.yaml'"),
     ('[floor_plan]\nimage = "plan.png"\npoints = [[0, 0, 0, 0]]\n', "two points"),
     ('[floor_plan]\nimage = "plan.png"\n', r"floor_plan\.points: missing"),
     ('[floor_plan]\nimage = "no.png"\npoints = [[0, 0, 0, 0], [9, 9, 1, 1]]\n', r"no\.png"),
     ("floor_plan = 3", "floor_plan"), ("", "bounds: missing")],
)  # fmt: skip
def test_unusable_plans_of_a_configuration_are_refused(tmp_path, plan, message):
    path = header_of(tmp_path, plan, bounds=False)
    with refused(match=message):
        scan_of("csv", path)


def test_image_of_a_grid_outside_the_folder_is_refused(tmp_path):
    path = header_of(tmp_path / "data", 'floor_plan = "map.yaml"')
    grid = write_grid(tmp_path / "data", np.full((8, 8), 254, np.uint8))
    grid.write_text(grid.read_text().replace("map.pgm", "/etc/hostname"))
    with pytest.raises(RequestError, match="--allow-outside"):
        scan_of("csv", path)


@pytest.mark.parametrize(
    "text",
    [
        "image: 'map#1.pgm' # it's a map\nresolution: .5\norigin: [1.0,\n  2.0, 0.0]\n",
        'image: "map\\x231.pgm"\nresolution: 5e-1\norigin:\n    - 1.0\n    - 2.0\n    - 0.0\n',
        '"image": >-\n  map#1.pgm\n"resolution" : &half 0.5\norigin: [1, 2, 0]\nx: *half\n',
        "%YAML 1.1\n---\nimage: map#1.pgm\nresolution: 0.5\norigin: [1, 2, 0]\nnegate: no\n...\n",
    ],
    ids=["lines", "escape", "folded and alias", "directive"],
)
def test_a_grid_may_be_any_valid_yaml(tmp_path, text):
    write_grid(tmp_path, np.zeros((4, 6), np.uint8))
    (tmp_path / "map.pgm").rename(tmp_path / "map#1.pgm")
    (tmp_path / "map.yaml").write_text(text)
    assert read_grid(tmp_path / "map.yaml").bounds == Bounds(1.0, 2.0, 4.0, 4.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [("image: map.pgm\norigin: [0, 0, 0]\n", "resolution: missing"),
     ("image: map.pgm\nresolution: -1\norigin: [0, 0, 0]\n", "resolution"),
     ("image: map.pgm\nresolution: 1\norigin: [0, 0, 0]\nmode: raw\n", "trinary or scale"),
     ("image: none.pgm\nresolution: 1\norigin: [0, 0, 0]\n", "none.pgm"),
     ("<html>\n", "expected KEY: VALUE"),
     ("image: map.pgm\nimage: other.pgm\n", "not valid YAML .*duplicate key"),
     ("image: !!bool map.pgm\n", "not valid YAML"),
     ("image: " + "[" * 1000, "nested too deeply"),
     ("a0: &a [x, x]\n" + "".join(f"a{n}: &{chr(97 + n)} [*{chr(96 + n)}, *{chr(96 + n)}]\n"
                                 for n in range(1, 25)), "more than 65,536 values"),
     ("image: &a [*a]\n", "more than 65,536 values")],
    ids=range(10),
)  # fmt: skip
def test_unusable_grids_are_refused_in_one_line(tmp_path, text, message):
    path = write_grid(tmp_path, np.zeros((3, 3), np.uint8))
    path.write_text(text)
    with refused(match=message):
        read_grid(path)
