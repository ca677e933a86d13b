"""Compare what a reader found with what was written."""

import math
from collections.abc import Sequence

import numpy as np

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
    assert found.poses.shape == (len(frames), 4, 4)
    for pose, frame in zip(found.poses, frames, strict=True):
        assert np.linalg.norm(pose[:3, 3] - frame.pose[:3, 3]) < 1e-3
        assert angle(pose, frame.pose) < 0.01
        np.testing.assert_allclose(pose[:3, :3].T @ pose[:3, :3], np.eye(3), atol=1e-9)
    for image in (found.frames[0].rgb, found.frames[-1].rgb):
        assert image.pixels == SIZE[0] * SIZE[1]
        assert image.read().pixels.shape == (*SIZE, 3)
        assert image.read().sha256 == image.checksum()


def angle(a: np.ndarray, b: np.ndarray) -> float:
    """Degrees between two poses; from the chord, which is exact for small angles."""
    chord = float(np.linalg.norm(a[:3, :3] - b[:3, :3])) / math.sqrt(8)
    return math.degrees(2 * math.asin(min(chord, 1.0)))


def reported(recording: Recording, kind: str) -> list[str]:
    """The files that issues of a kind name."""
    return [issue.file for issue in recording.issues if issue.kind == kind]
