from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from s2rtools.datasets import Recording, ReadOptions, read
from tests.datasets.layouts.bag_writer import CAMERA, FORMATS, K, RGB, nanoseconds, walk_bag
from tests.datasets.layouts.rooms import Walk, assert_poses, image, kinds, walk


@pytest.fixture
def scene() -> Walk:
    return walk(8)


def assert_images(recording: Recording, scene: Walk) -> None:
    (trajectory,) = recording.trajectories.values()
    assert len(trajectory.frames) == len(scene)
    for row in np.random.default_rng(0).permutation(len(scene)).tolist():
        frame = trajectory.frames[row]
        np.testing.assert_array_equal(image(frame.rgb.read()).pixels, scene.rgb[row])
        assert frame.rgb.checksum() == image(frame.rgb.read()).sha256
        assert frame.rgb.pixels == scene.rgb[row][..., 0].size
        assert frame.depth is not None
        np.testing.assert_array_equal(image(frame.depth.read()).pixels, scene.depth[row])


@pytest.mark.parametrize("name", FORMATS)
def test_images_poses_and_intrinsics_are_those_that_were_written(
    tmp_path: Path, scene: Walk, name: str
) -> None:
    walk_bag(tmp_path / name, scene).write()
    recording = read("bag", tmp_path / name)
    assert_poses(recording, scene.poses)
    assert_images(recording, scene)
    camera = recording.camera
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (K[0], K[4], K[2] + 0.5, K[5] + 0.5)
    assert camera.distortion == ()
    assert recording.depth_camera is None
    assert recording.depth_scale == 0.001
    assert recording.is_metric
    assert recording.up == (0.0, 0.0, 1.0)
    assert kinds(recording) == {}
    (trajectory,) = recording.trajectories.values()
    np.testing.assert_allclose(trajectory.timestamps, scene.times, atol=1e-6)
    assert trajectory.frames[1].rgb.name == f"{name}:{RGB}:{nanoseconds(scene)[1]}"
    assert recording.provenance[next(iter(recording.trajectories))]["camera_frame"] == CAMERA
