"""Samples of a batch that heat of any size and ray is looked up from, and totals that merge."""

from dataclasses import replace

import numpy as np
import pytest

from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.geometry.floor_grid import FloorHeat, Projector
from s2rstore.geometry.map_grid import MapGrid
from s2rstore.geometry.reprojection import NearerSurface
from s2rstore.records import Bounds, Dataset, Domain, Intrinsics

FRAME = (120, 160)
BOUNDS = Bounds(-6.0, -5.0, 10.0, 7.0)
DATASET = Dataset("d", "0" * 64, BOUNDS, True, None, 10.0, *FRAME)
SIM = Domain(
    "sim", "sim", Intrinsics(90, 90, 82, 60, -0.1), Intrinsics(70, 70, 80, 60, 0.02),
    0.6, -0.05, 1e-3, 1, 9000,
)  # fmt: skip
REAL = replace(SIM, domain="real", kind="real", camera_height=0.7)
OFFSET = RigOffset(height=-0.1, zoom=1.06)
POSES = np.array([[0.0, 0, 0], [1, 1, 1], [2, -1, -2], [90, 90, 0]])


def depths(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 9500, (4, *FRAME)).astype(np.uint16)


def heat(shape: tuple[int, int], seed: int) -> np.ndarray:
    """Float16 values as they are stored, with gaps and infinities."""
    rng = np.random.default_rng(seed)
    values = rng.normal(0, 1e4, (4, *shape)).astype(np.float16)
    values[rng.random(values.shape) < 0.2] = np.nan
    values[:, 0, 0] = np.inf
    return values.astype(np.float32)


@pytest.mark.parametrize("side", ["sim", "real"])
@pytest.mark.parametrize("surface", [None, "own", "nearer"])
def test_samples_of_a_batch_serve_heat_of_any_size_and_ray(side, surface):
    view, other = (SIM, REAL) if side == "sim" else (REAL, SIM)
    own_depth, other_depth, grid = depths(1), depths(2), MapGrid(BOUNDS)
    floor_heat = FloorHeat(view, other, DATASET, side, OFFSET, surface)
    assert floor_heat.needs_other == (surface == "nearer")
    samples = floor_heat.samples(own_depth, other_depth, POSES, grid)
    if surface is not None:
        view, other = (
            (view, OFFSET.applied(other)) if side == "sim" else (OFFSET.applied(view), other)
        )
    depth = NearerSurface(view, other, FRAME)(own_depth, other_depth)
    depth = depth if surface == "nearer" else own_depth
    projector = Projector(view, FRAME, True)
    for shape, ray in (((6, 6), "rgb"), ((6, 6), "depth"), ((30, 40), "rgb"), ((6, 6), "rgb")):
        values = heat(shape, 3)
        of_images = [
            projector.project(values[[i]], depth[[i]], POSES[[i]], ray, grid) for i in range(4)
        ]
        assert [part[0].size > 0 for part in of_images] == [True, True, True, False]
        for found, *expected in zip(samples.values(values, ray), *of_images, strict=True):
            np.testing.assert_array_equal(found, np.concatenate(expected))
            assert np.isfinite(found).all()


def test_samples_of_one_ray_refuse_heat_of_another():
    grid, values = MapGrid(BOUNDS), heat((6, 6), 3)
    every = FloorHeat(SIM, REAL, DATASET, "sim", None, None).samples(depths(1), None, POSES, grid)
    rgb = FloorHeat(SIM, REAL, DATASET, "sim", None, None, "rgb")
    samples = rgb.samples(depths(1), None, POSES, grid)
    for found, expected in zip(
        samples.values(values, "rgb"), every.values(values, "rgb"), strict=True
    ):
        np.testing.assert_array_equal(found, expected)
    with pytest.raises(ValueError, match="heat of the depth ray at samples of the rgb ray"):
        samples.values(values, "depth")


def test_the_nearer_surface_needs_the_depth_of_the_other_side():
    floor_heat = FloorHeat(SIM, REAL, DATASET, "sim", OFFSET, "nearer")
    with pytest.raises(ValueError, match="depth of both sides"):
        floor_heat.samples(depths(1), None, POSES, MapGrid(BOUNDS))
