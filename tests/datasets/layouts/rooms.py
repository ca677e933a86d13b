"""Images and poses of a walk, from which the tests write recordings of each layout."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from s2rtools.datasets.recording import Recording, SourceImage

WIDTH, HEIGHT = 24, 16


@dataclass(frozen=True)
class Walk:
    """RGB (N, H, W, 3), depth (N, H, W) in millimetres, and poses (N, 4, 4) camera to world.

    The camera's axes are x right, y down, z forward; times are seconds.
    """

    rgb: np.ndarray
    depth: np.ndarray
    poses: np.ndarray
    times: np.ndarray

    def __len__(self) -> int:
        return len(self.times)


def walk(count: int = 6, seed: int = 1) -> Walk:
    random = np.random.default_rng(seed)
    times = 1_700_000_000 + 0.1 * np.arange(count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    turns = np.array([0.3, -1.2, 0.4]) + np.outer(0.2 * np.arange(count), [0.1, 0.2, 1.0])
    poses[:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
    steps = np.outer(np.arange(count), [0.05, -0.02, 0.01])
    poses[:, :3, 3] = np.array([1.0, 2.0, 1.5]) + steps
    return Walk(
        random.integers(0, 256, (count, HEIGHT, WIDTH, 3), dtype=np.uint8),
        random.integers(400, 9000, (count, HEIGHT, WIDTH), dtype=np.uint16),
        poses,
        times,
    )


def write_png(path: Path, pixels: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    content = cv2.imencode(".png", pixels[..., ::-1] if pixels.ndim == 3 else pixels)[1]
    path.write_bytes(content.tobytes())


def image(read: object) -> SourceImage:
    assert isinstance(read, SourceImage), read
    return read


def assert_poses(recording: Recording, poses: np.ndarray, trajectory: str = "") -> None:
    """Positions agree within 0.1 mm, rotations within 0.001 degrees."""
    name = trajectory or next(iter(recording.trajectories))
    found = recording.trajectories[name].poses
    assert found.shape == poses.shape
    np.testing.assert_allclose(found[:, :3, 3], poses[:, :3, 3], atol=1e-4)
    apart = Rotation.from_matrix(found[:, :3, :3]).inv() * Rotation.from_matrix(poses[:, :3, :3])
    assert np.rad2deg(apart.magnitude()).max() < 1e-3
