"""Compare what a reader found with what was written."""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from s2rtools.datasets.layouts import read
from s2rtools.datasets.recording import ReadOptions, RecordedTrajectory, Recording
from tests.datasets.layouts.recordings import SIZE, Frame


def read_with(layout: str, path, trajectories=(), allow_outside=False, **values) -> Recording:
    return read(layout, path, ReadOptions(values, tuple(trajectories), allow_outside))


def only(recording: Recording) -> RecordedTrajectory:
    (trajectory,) = recording.trajectories.values()
    return trajectory


def assert_found(found: RecordedTrajectory, frames: Sequence[Frame]) -> None:
    """Names, checksums and times equal; poses within 1 mm and 0.01 degrees; images decode."""
    assert [frame.rgb.name for frame in found.frames] == [frame.rgb for frame in frames]
    assert [frame.rgb.checksum() for frame in found.frames] == [f.rgb_sha256 for f in frames]
    depth = [frame.depth for frame in found.frames]
    assert [d and d.name for d in depth] == [frame.depth for frame in frames]
    assert [d and d.checksum() for d in depth] == [frame.depth_sha256 for frame in frames]
    np.testing.assert_allclose(found.timestamps, [frame.time for frame in frames], atol=1e-6)
    truth = np.array([frame.pose for frame in frames])
    assert found.poses.shape == truth.shape
    assert np.linalg.norm((found.poses - truth)[:, :3, 3], axis=1).max() < 1e-3
    rotations = found.poses[:, :3, :3]
    apart = Rotation.from_matrix(rotations).inv() * Rotation.from_matrix(truth[:, :3, :3])
    assert np.rad2deg(apart.magnitude()).max() < 0.01
    assert np.abs(np.swapaxes(rotations, 1, 2) @ rotations - np.eye(3)).max() < 1e-9
    for image in (found.frames[0].rgb, found.frames[-1].rgb):
        assert image.pixels == SIZE[0] * SIZE[1]
        assert image.read().pixels.shape == (*SIZE, 3)
        assert image.read().sha256 == image.checksum()


def reported(recording: Recording, kind: str) -> list[str]:
    """The files that issues of a kind name."""
    return [issue.file for issue in recording.issues if issue.kind == kind]
