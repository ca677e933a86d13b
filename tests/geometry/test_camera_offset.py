"""Camera adjustments: accumulation, unchanged parameters and rejected values."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.geometry.camera_offset import UNCHANGED, RenderChange, hfov, render_change
from s2rstore.records import Domain, Intrinsics

WIDTH = 128


def domain(hfov_degrees: float = 72.0, height: float = 0.6, pitch: float = 0.0) -> Domain:
    focal = WIDTH / 2 / math.tan(math.radians(hfov_degrees) / 2)
    lens = Intrinsics(focal, focal * 1.2, 64.0, 60.0, pitch)
    depth = Intrinsics(focal * 0.8, focal * 0.9, 66.0, 61.0, pitch + 0.02)
    return Domain("sim", "sim", lens, depth, height, 0.1, 0.001, 1, 10000)


def chain(**values: float) -> list[dict[str, object]]:
    return [{"name": name, "value": value} for name, value in values.items()]


def test_neutral_adjustments_return_the_same_domain():
    original = domain()
    for steps in ([], chain(brightness=1.4), chain(camera_height=0.0, camera_fov=0.0)):
        move = render_change(steps, original, WIDTH)
        assert move == UNCHANGED
        assert move.applied(original) is original


@given(
    st.floats(-0.5, 1.0), st.floats(-30, 30), st.floats(-30, 30), st.floats(50, 90),
    st.floats(-0.2, 0.2),
)  # fmt: skip
def test_camera_parameters_change_by_the_adjustments(up, pitch, hfov_change, hfov_before, tilt):
    original = domain(hfov_before, pitch=tilt)
    steps = chain(camera_height=up, camera_pitch=pitch, camera_fov=hfov_change)
    moved = render_change(steps, original, WIDTH).applied(original)
    assert moved.camera_height == pytest.approx(original.camera_height + up)
    assert hfov(moved.rgb, WIDTH) == pytest.approx(hfov(original.rgb, WIDTH) + hfov_change)
    for lens, before in ((moved.rgb, original.rgb), (moved.depth, original.depth)):
        assert math.degrees(lens.pitch - before.pitch) == pytest.approx(pitch)
        assert lens.fx / before.fx == pytest.approx(moved.rgb.fx / original.rgb.fx)
        assert lens.fy / lens.fx == pytest.approx(before.fy / before.fx)
        assert (lens.cx, lens.cy) == (before.cx, before.cy)
    assert (moved.depth_scale, moved.forward_offset) == (
        original.depth_scale,
        original.forward_offset,
    )


def test_repeated_camera_adjustments_add_up_and_others_are_ignored():
    steps = [*chain(camera_height=0.1), *chain(contrast=2.0), *chain(camera_height=0.25)]
    assert render_change(steps, domain(), WIDTH) == RenderChange(height=pytest.approx(0.35))
    cancelling = [*chain(camera_fov=5.0), *chain(camera_fov=-5.0)]
    assert render_change(cancelling, domain(), WIDTH) == UNCHANGED


def test_lights_multiply_and_move_no_camera():
    original = domain()
    move = render_change([*chain(lamp_power=0.5), *chain(window_power=2.0)], original, WIDTH)
    assert move == RenderChange(lamps=0.5, windows=2.0) != UNCHANGED
    assert move.applied(original) is original


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        (chain(camera_height=-0.6), "0.60 m above the floor"),
        (chain(camera_fov=100.0), "-67 .. +88 degrees"),
        (chain(camera_fov=-70.0), "-67 .. +88 degrees"),
        (chain(camera_pitch=85.0), "at most 80 degrees"),
    ],
)
def test_impossible_cameras_are_rejected(steps, expected):
    with pytest.raises(RequestError, match=expected.replace("+", r"\+")):
        render_change(steps, domain(), WIDTH)
