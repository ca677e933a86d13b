"""The MuJoCo room: depth, camera, lights and textures of its frames."""

import numpy as np
import pytest

from s2rstore.records import Domain, Intrinsics
from s2rtools.renderer import Hello
from s2rtools.simulated_frames.requested_poses import camera_poses

pytest.importorskip("mujoco")
from examples.renderers import mujoco_room as room

_LENS = Intrinsics(80.0, 80.0, 60.0, 48.0)
_DOMAIN = Domain("sim", "sim", _LENS, _LENS, 1.0, 0.0, 0.001, 1, 65534)
_DEFAULTS = {parameter.name: parameter.default for parameter in room.PARAMETERS}
_PICTURE = 3.98
"""Metres from the camera to the picture at x = 2.2 .. 3.8 m and z = 1 .. 2 m."""


@pytest.fixture(scope="module")
def view():
    """Renders the wall with the picture, 4 m before the camera."""
    try:
        scene = room.Room(128, 96)
    except Exception as error:
        pytest.skip(f"no off-screen rendering: {error}")
    (pose,) = camera_poses(np.array([[3.0, 1.0, np.pi / 2]]), _DOMAIN, False)

    def render(cx=_LENS.cx, cy=_LENS.cy, **values):
        camera = Hello(width=128, height=96, fx=_LENS.fx, fy=_LENS.fy, cx=cx, cy=cy, y_down=False,
                       folder="")  # fmt: skip
        return scene.render(pose, camera, _DEFAULTS | values)

    return render


def _picture(depth):
    """Columns and rows of the picture: first and one after the last."""
    rows, columns = np.nonzero(np.abs(depth - _PICTURE) < 0.003)
    return columns.min(), columns.max() + 1, rows.min(), rows.max() + 1


@pytest.mark.parametrize(("cx", "cy"), [(60.0, 48.0), (70.0, 40.0)])
def test_the_picture_is_where_a_pinhole_sees_it(view, cx, cy):
    _, depth = view(cx, cy)
    half, height = 80 * 0.8 / _PICTURE, 80 * 1.0 / _PICTURE
    expected = [cx - half, cx + half, cy - height, cy]
    np.testing.assert_allclose(_picture(depth), expected, atol=0.51)
    assert depth[int(cy) - 5, int(cx) + 24] == pytest.approx(4.0, abs=2e-3)


def test_the_camera_moves_by_parameters(view):
    left, right, _, bottom = _picture(view(zoom=1.25, camera_height=0.2)[1])
    assert right - left == pytest.approx(100 * 1.6 / _PICTURE, abs=1)
    assert bottom == pytest.approx(48 + 100 * 0.2 / _PICTURE, abs=1)
    pitched = view(camera_pitch=5.0)[1]
    level = view()[1]
    assert (pitched[48] > 0).all()
    assert not np.array_equal(pitched, level)
    bent = view(distortion=-0.2)[1]
    left, right, *_ = _picture(bent)
    assert right - left < 80 * 1.6 / _PICTURE


def test_lights_and_textures_change_the_image_alone(view):
    rgb, depth = view()
    for name, value, brightness in (("lamp_power", 0.5, -1), ("window_power", 2.0, 1)):
        changed, same = view(**{name: value})
        assert (changed.mean() - rgb.mean()) * brightness > 2
        np.testing.assert_array_equal(same, depth)
    assert view(texture_contrast=2.0)[0].std() > rgb.std() + 2
    np.testing.assert_array_equal(view()[0], rgb)
