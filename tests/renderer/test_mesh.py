"""A textured mesh as a renderer: colours, depth and place of what stands before the camera."""

import numpy as np
import pytest

from examples.phone_scan import write_glb
from s2rstore.records import Domain, Intrinsics
from s2rtools.renderer.mesh import PARAMETERS, mesh_renderer, placement_of
from s2rtools.renderer.protocol import Hello
from s2rtools.simulated_frames.requested_poses import camera_poses

pytest.importorskip("vtkmodules")

_SIZE = 64
_LENS = Intrinsics(_SIZE / 2, _SIZE / 2, _SIZE / 2, _SIZE / 2)
_DOMAIN = Domain("sim", "sim", _LENS, _LENS, 1.0, 0.0, 0.001, 1, 65534)
_DEFAULTS = {parameter.name: parameter.default for parameter in PARAMETERS}


@pytest.fixture(scope="module")
def wall(tmp_path_factory):
    """A .glb of a wall at x = 3 m, 4 m wide and 2 m high around z = 1 m.

    It is red left and blue right, and greener in its upper half.

    Left is y > 0 as seen from x = 0. glTF's axes: x as that of the map, y up, z = -y of the map.
    """
    path = tmp_path_factory.mktemp("mesh") / "wall.glb"
    texture = np.zeros((8, 8, 3), np.uint8)
    texture[:, :4] = (200, 60, 40)
    texture[:, 4:] = (30, 80, 220)
    texture[:4, :, 1] += 100
    write_glb(path, [(np.array([(3, 0, -2), (3, 0, 2), (3, 2, 2), (3, 2, -2)]), texture)])
    return path


def _view(path, pose=(1.0, 0.0, 0.0), y_down=False, points=None, **values):
    camera = Hello(width=_SIZE, height=_SIZE, fx=_LENS.fx, fy=_LENS.fy, cx=_LENS.cx, cy=_LENS.cy,
                   y_down=y_down, folder="")  # fmt: skip
    (at,) = camera_poses(np.array([pose]), _DOMAIN, y_down)
    return mesh_renderer(path, points)(at, camera, _DEFAULTS | values)


def test_textures_and_depth_are_those_of_the_mesh(wall):
    rgb, depth = _view(wall)
    assert rgb[40, 20].tolist() == [200, 60, 40]
    assert rgb[40, 44].tolist() == [30, 80, 220]
    assert rgb[24, 20].tolist() == [200, 160, 40]
    seen = depth > 0
    assert seen.any()
    assert not rgb[~seen].any()
    np.testing.assert_allclose(depth[seen], 2.0, atol=1e-3)
    # 2 m before the camera, 1 m up and down is half a focal length: rows 16 to 48.
    rows = np.flatnonzero(seen[:, 32])
    assert (rows[0], rows[-1]) == (16, 47)


def test_the_camera_moves_by_parameters(wall):
    _, depth = _view(wall, camera_height=0.5, zoom=2.0)
    rows = np.flatnonzero(depth[:, 32])
    assert (rows[0], rows[-1]) == (16, 63)
    _, depth = _view(wall, camera_pitch=20.0)
    assert np.flatnonzero(depth[:, 32])[0] > 16


def test_brightness_changes_the_image_alone(wall):
    dark, depth = _view(wall, brightness=0.5)
    assert dark[40, 20].tolist() == [100, 30, 20]
    np.testing.assert_array_equal(depth, _view(wall)[1])


def test_points_place_the_mesh_on_a_map_whose_y_grows_downwards(wall, tmp_path):
    points = tmp_path / "points.csv"
    # The map is the mesh at twice the size, moved by (10, 20), with y downwards.
    points.write_text("mesh_x,mesh_y,x_m,y_m\n0,0,10,20\n3,0,16,20\n0,2,10,16\n")
    np.testing.assert_allclose(placement_of(points, True) @ [3, 2, 1, 1], [16, -16, 2, 1])
    rgb, depth = _view(wall, (12.0, 20.0, 0.0), True, points)
    np.testing.assert_allclose(depth[depth > 0], 4.0, atol=2e-3)
    assert rgb[36, 20].tolist() == [200, 60, 40]
