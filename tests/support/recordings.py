"""Recordings with known poses: images in files and one JSON file, and a layout that reads them."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedFrame,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.recorded_files import ImageFile

CAMERA = PinholeCamera(32, 24, 30.0, 30.0, 16.0, 12.0)
HEIGHT = 0.6
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """A side to write: poses (N, 3) on the floor by trajectory, names of images, and times."""

    poses: dict[str, Floats]
    names: dict[str, list[str]]
    times: dict[str, list[float]]


def walk(n: int, seed: int = 0, step: float = 1.0) -> Floats:
    """Poses (n, 3) of a walk around a square: x, y in metres, heading in radians."""
    t = np.linspace(0, 2 * np.pi, n, endpoint=False)
    radius = n * step / (2 * np.pi)
    poses = np.column_stack([radius * np.cos(t), radius * np.sin(t), t + np.pi / 2])
    return poses + np.random.default_rng(seed).normal(0, 0.01, poses.shape)


def side(poses: Floats, order: NDArray[np.intp] | None = None, name: str = "walk") -> Side:
    """One trajectory of poses in another order; image `image-I` has pose I and time I / 10 s."""
    order = np.arange(len(poses)) if order is None else order
    return Side(
        {name: poses[order]},
        {name: [f"image-{i:04d}" for i in order]},
        {name: [float(i) / 10 for i in order]},
    )


def write(
    folder: Path, side: Side, camera: PinholeCamera = CAMERA, has_depth: bool = True, seed: int = 0
) -> Path:
    """Write a recording; pixels are random, depth is 2 m in units of millimetres."""
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True)
    for name, images in side.names.items():
        (folder / name).mkdir()
        for image in images:
            rgb = rng.integers(0, 255, (camera.height, camera.width, 3)).astype(np.uint8)
            cv2.imwrite(str(folder / name / f"{image}.png"), rgb)
            if has_depth:
                depth = np.full((camera.height, camera.width), 2000, dtype=np.uint16)
                (folder / name / "depth").mkdir(exist_ok=True)
                cv2.imwrite(str(folder / name / "depth" / f"{image}.png"), depth)
    facts = {
        "camera": asdict(camera),
        "depth": has_depth,
        "poses": {name: poses.tolist() for name, poses in side.poses.items()},
        "names": side.names,
        "times": side.times,
    }
    (folder / "recording.json").write_text(json.dumps(facts))
    return folder


def camera_poses(poses: Floats) -> Floats:
    """Camera poses (N, 4, 4) in a world whose z points up, of level cameras at `HEIGHT`."""
    result = np.zeros((len(poses), 4, 4))
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    result[:, 0, 0], result[:, 1, 0] = sin, -cos  # right
    result[:, 2, 1] = -1  # down
    result[:, 0, 2], result[:, 1, 2] = cos, sin  # forward
    result[:, :2, 3], result[:, 2, 3], result[:, 3, 3] = poses[:, :2], HEIGHT, 1
    return result


def _read(path: Path, options: ReadOptions) -> Recording:
    facts = json.loads((path / "recording.json").read_text())
    facts["camera"]["distortion"] = tuple(facts["camera"]["distortion"])
    recording = Recording("test", path.name, path, PinholeCamera(**facts["camera"]))
    recording.up = (0.0, 0.0, 1.0)
    for name, poses in facts["poses"].items():
        frames = [
            RecordedFrame(
                ImageFile(path / name / f"{image}.png", f"{name}/{image}.png"),
                ImageFile(
                    path / name / "depth" / f"{image}.png",
                    f"{name}/depth/{image}.png",
                    is_depth=True,
                )
                if facts["depth"]
                else None,
            )
            for image in facts["names"][name]
        ]
        recording.trajectories[name] = RecordedTrajectory(
            frames, camera_poses(np.array(poses)), np.array(facts["times"][name])
        )
    return recording


LAYOUT = Layout(_read, "recordings of the tests")
