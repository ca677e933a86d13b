"""Back-projection of one heatmap against a loop over its pixels."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bench.budget import BudgetRow, seconds
from s2rstore.geometry.floor_grid import SAMPLES, Projector
from s2rstore.geometry.map_grid import MapGrid
from s2rstore.records import Bounds, Domain, Intrinsics


def figures() -> Iterator[BudgetRow]:
    """Project a 128 x 128 heatmap on the pixels of the RGB camera."""
    f = 128 / math.tan(math.radians(40))
    camera = Intrinsics(f, f, 128, 128)
    domain = Domain("d", "sim", camera, camera, 0.6, 0.0, 10 / 255, 6, 249)
    rng = np.random.default_rng(0)
    depth = rng.integers(0, 256, (256, 256)).astype(np.uint8)
    heat = rng.random((128, 128)).astype(np.float32)
    pose = np.array([[10.0, 10.0, 0.3]])
    grid = MapGrid(Bounds(0, 0, 20, 20))
    projector = Projector(domain, (256, 256), True)
    fast = seconds(lambda: projector.project(heat[None], depth[None], pose, "rgb", grid), 50)
    slow = seconds(lambda: _loop(heat, depth, domain, pose[0], grid), 3)
    yield BudgetRow("back-projection, a loop over pixels", 1000 * slow, "ms")
    yield BudgetRow("back-projection of a 128 x 128 heatmap", 1000 * fast, "ms", 0.5)
    yield BudgetRow("back-projection / loop", fast / slow, "ratio")


def _loop(
    heat: np.ndarray, depth: np.ndarray, domain: Domain, pose: np.ndarray, grid: MapGrid
) -> np.ndarray:
    total = np.zeros((grid.rows, grid.cols))
    for row in range(SAMPLES):
        for col in range(SAMPLES):
            raw = int(depth[2 * row + 1, 2 * col + 1])
            if not domain.depth_raw_min <= raw <= domain.depth_raw_max:
                continue
            d = raw * domain.depth_scale
            right = d * (2 * col + 1 - domain.depth.cx) / domain.depth.fx
            up = -d * (2 * row + 1 - domain.depth.cy) / domain.depth.fy
            if not 0.1 <= domain.camera_height + up <= 2.0:
                continue
            x = pose[0] + d * math.cos(pose[2]) - right * math.sin(pose[2])
            y = pose[1] + d * math.sin(pose[2]) + right * math.cos(pose[2])
            c, r = int(x / 20 * grid.cols), int(y / 20 * grid.rows)
            if 0 <= c < grid.cols and 0 <= r < grid.rows:
                total[r, c] += heat[row, col]
    return total
