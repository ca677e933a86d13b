"""The packaged calibration compared with the real images."""

import math
from dataclasses import replace
from importlib import resources
from pathlib import Path

import cv2
import numpy as np
import pytest

from s2rstore.geometry.floor_grid import Projector
from s2rstore.records import Domain, Intrinsics
from s2rtools.datasets.dataset_config import DatasetConfig
from s2rtools.datasets.importers import IMPORTERS
from s2rtools.datasets.scan import ScanOptions

FRAME = (256, 256)
EVERY = 2

pytestmark = pytest.mark.real


def declared(name: str) -> Domain:
    packaged = resources.files("s2rtools.datasets.importers") / "sim2realviz.toml"
    with resources.as_file(packaged) as path:
        return DatasetConfig(path, name="", y_down=True).domain(name, FRAME)


@pytest.fixture(scope="module")
def views(real_data: Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Depth of every domain, (n, 256, 256) raw values, and the poses (n, 3)."""
    scan = IMPORTERS["sim2realviz"](real_data, ScanOptions(("traj1",)))
    records = scan.trajectories["traj1"][::EVERY]
    depths = {}
    for name in ("sim", "sim_edit"):
        files = [
            cv2.imread(str(row.sources[name].files[1]), cv2.IMREAD_GRAYSCALE) for row in records
        ]
        depths[name] = np.stack(
            [cv2.resize(file, FRAME, interpolation=cv2.INTER_NEAREST_EXACT) for file in files]
        )
    return depths, np.array([[row.x, row.y, row.heading] for row in records])


def hfov(degrees: float, pitch: float = 0.0) -> Intrinsics:
    f = FRAME[1] / 2 / math.tan(math.radians(degrees) / 2)
    return Intrinsics(f, f, FRAME[1] / 2, FRAME[0] / 2, pitch)


def entropy(record: Domain, depth: np.ndarray, poses: np.ndarray, y_down: bool = True) -> float:
    """Entropy in nats of the 5 cm top-down histogram of points 0.3 .. 1.5 m above the floor."""
    x, y, _, valid = Projector(record, FRAME, y_down, (0.3, 1.5)).points(depth, poses)
    cells = np.floor(x[valid] / 0.05).astype(int) * 100_000 + np.floor(y[valid] / 0.05).astype(int)
    share = np.unique(cells, return_counts=True)[1] / cells.size
    return float(-(share * np.log(share)).sum())


def test_the_declared_camera_of_sim_edit_gives_the_sharpest_map(views):
    depth, poses = views[0]["sim_edit"], views[1]
    record = declared("sim_edit")
    best = entropy(record, depth, poses)
    for degrees in (75, 85):
        assert entropy(replace(record, depth=hfov(degrees)), depth, poses) - best >= 0.2
    assert entropy(record, depth, poses, y_down=False) - best >= 1
    assert entropy(record, depth, poses * [1, 1, -1]) - best >= 1
    assert entropy(replace(record, forward_offset=0.0), depth, poses) > best
