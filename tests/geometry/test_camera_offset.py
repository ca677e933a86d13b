"""Cameras that adjustments move: what adds up, what stays and what is refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rstore.geometry.camera_offset import UNMOVED, RigOffset, camera_move, hfov
from s2rstore.records import Domain, Intrinsics

WIDTH = 128


def domain(hfov_degrees: float = 72.0, height: float = 0.6, pitch: float = 0.0) -> Domain:
    focal = WIDTH / 2 / math.tan(math.radians(hfov_degrees) / 2)
    lens = Intrinsics(focal, focal * 1.2, 64.0, 60.0, pitch)
    depth = Intrinsics(focal * 0.8, focal * 0.9, 66.0, 61.0, pitch + 0.02)
    return Domain("sim", "sim", lens, depth, height, 0.1, 0.001, 1, 10000)


def chain(**values: float) -> list[dict[str, object]]:
    return [{"name": name, "value": value} for name, value in values.items()]


def test_nothing_moves_the_very_same_domain() -> None:
    plain = domain()
    for steps in ([], chain(brightness=1.4), chain(camera_height=0.0, camera_fov=0.0)):
        move = camera_move(steps, plain, WIDTH)
        assert move == UNMOVED
        assert move.applied(plain) is plain


@given(
    st.floats(-0.5, 1.0), st.floats(-30, 30), st.floats(-30, 30), st.floats(50, 90),
    st.floats(-0.2, 0.2),
)  # fmt: skip
def test_figures_change_by_what_was_asked(
    up: float, pitch: float, wider: float, now: float, tilt: float
) -> None:
    plain = domain(now, pitch=tilt)
    steps = chain(camera_height=up, camera_pitch=pitch, camera_fov=wider)
    made = camera_move(steps, plain, WIDTH).applied(plain)
    assert made.camera_height == pytest.approx(plain.camera_height + up)
    assert hfov(made.rgb, WIDTH) == pytest.approx(hfov(plain.rgb, WIDTH) + wider)
    for lens, before in ((made.rgb, plain.rgb), (made.depth, plain.depth)):
        assert math.degrees(lens.pitch - before.pitch) == pytest.approx(pitch)
        assert lens.fx / before.fx == pytest.approx(made.rgb.fx / plain.rgb.fx)
        assert lens.fy / lens.fx == pytest.approx(before.fy / before.fx)
        assert (lens.cx, lens.cy) == (before.cx, before.cy)
    assert (made.depth_scale, made.forward_offset) == (plain.depth_scale, plain.forward_offset)


def test_steps_of_one_name_add_up_and_images_are_passed_over() -> None:
    steps = [*chain(camera_height=0.1), *chain(contrast=2.0), *chain(camera_height=0.25)]
    assert camera_move(steps, domain(), WIDTH) == RigOffset(height=pytest.approx(0.35))
    back = [*chain(camera_fov=5.0), *chain(camera_fov=-5.0)]
    assert camera_move(back, domain(), WIDTH) == UNMOVED


@pytest.mark.parametrize(
    ("steps", "told"),
    [
        (chain(camera_height=-0.6), "0.60 m above the floor"),
        (chain(camera_fov=100.0), "-67 .. +88 degrees"),
        (chain(camera_fov=-70.0), "-67 .. +88 degrees"),
        (chain(camera_pitch=85.0), "at most 80 degrees"),
    ],
)
def test_cameras_that_make_no_sense_are_refused(steps: list[dict], told: str) -> None:
    with pytest.raises(RequestError, match=told.replace("+", r"\+")):
        camera_move(steps, domain(), WIDTH)
