"""What `s2r render` renders: poses of a file, on a grid of the free floor or random; parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rstore.files.planned_poses import read_planned_poses
from s2rstore.reader import Store
from s2rstore.records import Domain
from s2rtools.common.command_line.assignments import parse_assignments, parse_number
from s2rtools.datasets.floor.free_floor import FreeFloor, turns
from s2rtools.datasets.recording import trajectory_name
from s2rtools.renderer.protocol import CameraPose, Ready

Poses = NDArray[np.float64]
"""(n, 3): x, y in metres and heading in radians, in the map."""
MOST_FRAMES = 100_000
_MOST_CELLS = 10_000_000
_DRAWS = 4096
_MOST_DRAWS = 1000
_LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Turns the optical axes of a level camera into x forward, y left, z up."""


@dataclass(frozen=True, slots=True, eq=False)
class RequestedPoses:
    """Poses with the name of the trajectory that each becomes a part of.

    `are_stored`: these are all instances of stored trajectories, in their order.
    """

    poses: Poses
    names: Sequence[str]
    are_stored: bool = False

    @classmethod
    def of_trajectory(cls, name: str, poses: Poses) -> RequestedPoses:
        """Poses that become one trajectory."""
        return cls(poses, [name] * len(poses))

    def renamed(self, name: str) -> RequestedPoses:
        """The same poses as another trajectory."""
        return RequestedPoses.of_trajectory(name, self.poses)


def poses_of_file(path: Path) -> RequestedPoses:
    """The poses of a CSV file with the columns x_m, y_m and heading_deg."""
    planned = read_planned_poses(path)
    rows = [(pose.x_m, pose.y_m, math.radians(pose.heading_deg)) for pose in planned]
    poses = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return RequestedPoses.of_trajectory(trajectory_name(path.stem), poses)


def poses_on_grid(store: Store, spacing: float, headings: int) -> RequestedPoses:
    """All headings at the centres of free square cells of `spacing` metres.

    Raises RequestError where these are none, or more than `MOST_FRAMES`.
    """
    places = FreeFloor.of_store(store, "render --grid").grid(spacing, _MOST_CELLS)
    count = len(places) * headings
    if not 0 < count <= MOST_FRAMES:
        reason = f"{count:,} poses; at most {MOST_FRAMES:,}" if count else "no cell is free"
        raise RequestError(f"--grid {spacing:g},{headings}: {reason}")
    poses = np.column_stack(
        [np.repeat(places, headings, axis=0), np.tile(turns(headings), len(places))]
    )
    return RequestedPoses.of_trajectory("grid", poses)


def random_poses(store: Store, count: int, seed: int) -> RequestedPoses:
    """Poses that are uniform over the free floor and over all headings.

    The first poses of a larger `count` are those of a smaller one.
    """
    floor = FreeFloor.of_store(store, "render --random")
    rng = np.random.default_rng(seed)
    found = np.empty((0, 3))
    for _ in range(_MOST_DRAWS):
        drawn = rng.random((_DRAWS, 3))
        drawn[:, :2] = floor.extent[0] + drawn[:, :2] * (floor.extent[1] - floor.extent[0])
        drawn[:, 2] = math.tau * drawn[:, 2] - math.pi
        found = np.concatenate([found, drawn[floor.is_free(drawn[:, :2], 0.0)]])
        if len(found) >= count:
            return RequestedPoses.of_trajectory(f"random-{seed}", found[:count])
    raise RequestError(f"--random {count}: the free floor is too small to draw them")


def missing_poses(store: Store, domain: str) -> RequestedPoses:
    """The poses of all instances of the trajectories of which a domain lacks images.

    Raises RequestError where there is none, and where some of their instances have no pose.
    """
    imaged = store.imaged_parts.get(domain, frozenset())
    names = list(dict.fromkeys(
        part.trajectory for part in store.trajectory_parts if part not in imaged
    ))  # fmt: skip
    if not names:
        raise RequestError(f"{store.path}: domain {domain} has images of all instances")
    iids = np.concatenate([store.iids_of(name) for name in names])
    truth = store.instances
    poses = np.column_stack([truth.x[iids], truth.y[iids], truth.heading[iids]])
    if not np.isfinite(poses).all():
        raise RequestError(f"{store.path}: some instances of {names[0]} have no pose to render")
    of_each = [name for name in names for _ in store.iids_of(name)]
    return RequestedPoses(poses, of_each, are_stored=True)


def camera_poses(poses: Poses, domain: Domain, y_down: bool) -> list[CameraPose]:
    """The poses of a domain's RGB camera in the world of the protocol."""
    hand = -1.0 if y_down else 1.0
    headings = poses[:, 2]
    x = poses[:, 0] + domain.forward_offset * np.cos(headings)
    y = poses[:, 1] + domain.forward_offset * np.sin(headings)
    turned = Rotation.from_euler("ZY", np.column_stack(
        [hand * headings, np.full(len(poses), -domain.rgb.pitch)]))  # fmt: skip
    quaternions = (turned * Rotation.from_matrix(_LEVEL)).as_quat(canonical=True)
    return [
        CameraPose(
            float(pose[0]), float(pose[1]), float(pose[2]),
            (float(east), hand * float(north), domain.camera_height),
            (float(q[3]), float(q[0]), float(q[1]), float(q[2])),
        )
        for pose, east, north, q in zip(poses, x, y, quaternions, strict=True)
    ]  # fmt: skip


def parameter_values(ready: Ready, assignments: Sequence[str]) -> dict[str, float]:
    """A value for each parameter that a renderer declares, `NAME=VALUE` in place of defaults.

    Raises RequestError for unknown names, for what is no number, and for values out of range.
    """
    declared = {parameter.name: parameter for parameter in ready.parameters}
    values = {name: parameter.default for name, parameter in declared.items()}
    for name, text in parse_assignments("--set", assignments, declared).items():
        parameter = declared[name]
        value = parse_number("--set", name, text)
        if not parameter.minimum <= value <= parameter.maximum:
            span = f"{parameter.minimum:g} to {parameter.maximum:g}"
            raise RequestError(f"--set {name}={text}: must be {span}")
        values[name] = value
    return values
