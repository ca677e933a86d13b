"""Views with other lights, and views of every n-th pixel."""

import numpy as np
import pytest

from s2rstore.geometry.camera_offset import LAMPS, UNCHANGED, WINDOWS, RenderChange, render_change
from s2rstore.records import Domain, Intrinsics
from s2rtools.synthetic_world.dataset import WorldData, WorldRecipe

LENS = Intrinsics(20.0, 20.0, 16.0, 16.0)


@pytest.fixture(scope="module")
def data() -> WorldData:
    return WorldData(WorldRecipe(seed=3, count=4, frame=32))


def test_neutral_lights_change_no_bit_and_factors_change_the_colours_alone(data):
    poses, numbers = data.poses["traj1"][:2], np.arange(2)
    plain = data.views("sim", poses, numbers)
    same = data.views("sim", poses, numbers, lights=(1.0, 1.0))
    np.testing.assert_array_equal(plain.rgb, same.rgb)
    nearly = data.views("sim", poses, numbers, lights=(1.0, 1.0 + 1e-9))
    assert np.abs(nearly.rgb.astype(int) - plain.rgb).max() <= 1
    bright = data.views("sim", poses, numbers, lights=(1.5, 1.0))
    assert bright.rgb.mean() > plain.rgb.mean() + 5
    np.testing.assert_array_equal(bright.depth, plain.depth)


@pytest.mark.parametrize("stride", [1, 2, 4])
def test_a_subsampled_camera_sees_the_centres_of_its_pixels(data, stride):
    poses, numbers = data.poses["traj1"][:2], np.arange(2)
    whole = data.views("sim", poses, numbers)
    part = data.views("sim", poses, numbers, data.camera("sim").subsampled(stride), samples=1)
    np.testing.assert_array_equal(part.depth, whole.depth[:, ::stride, ::stride])


def test_lights_of_a_chain_multiply_and_move_no_camera():
    domain = Domain("sim", "sim", LENS, LENS, 0.6, 0.0, 0.001, 1, 10_000)
    steps = [{"name": LAMPS, "value": 0.5}, {"name": WINDOWS, "value": 2.0}]
    move = render_change(steps, domain, 32)
    assert move == RenderChange(lamps=0.5, windows=2.0)
    assert move != UNCHANGED
    assert move.applied(domain) is domain
