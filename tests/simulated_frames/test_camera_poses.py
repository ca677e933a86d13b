"""Poses of cameras in the world of the protocol agree with the projection of the store."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.geometry.camera import rays, to_floor
from s2rstore.records import Domain, Intrinsics
from s2rtools.simulated_frames.requested_poses import camera_poses

_LENS = Intrinsics(100.0, 90.0, 60.0, 40.0)
_DOMAIN = Domain("sim", "sim", _LENS, _LENS, 1.2, 0.1, 0.001, 1, 65534)


@pytest.mark.parametrize("y_down", [False, True])
@given(st.floats(-3.2, 3.2), st.floats(-1.2, 1.2), st.floats(0, 120), st.floats(0, 80))
def test_a_point_is_where_the_store_projects_it(y_down, heading, pitch, column, row):
    domain = replace(_DOMAIN, depth=replace(_LENS, pitch=pitch), rgb=replace(_LENS, pitch=pitch))
    poses = np.array([[3.0, -2.0, heading]])
    (pose,) = camera_poses(poses, domain, y_down)
    ray = rays(domain.depth, np.array([row]), np.array([column]))
    x, y, height = to_floor(ray, np.full((1, 1, 1), 2.5), domain, poses, y_down)
    optical = [(column - _LENS.cx) / _LENS.fx, (row - _LENS.cy) / _LENS.fy, 1.0]
    world = np.array(pose.position) + 2.5 * pose.rotation @ optical
    expected = [x.item(), -y.item() if y_down else y.item(), height.item()]
    np.testing.assert_allclose(world, expected, atol=1e-9)
