"""Relighting finds the light and ignores changed content."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rtools.counterfactual.relighting import relight
from s2rtools.synthetic_world.world import standard_camera
from tests.counterfactual.views import FRAME, SIZE, metres, rendered

ALL = np.ones(FRAME, np.float32)


def source(number: int = 1) -> tuple[np.ndarray, np.ndarray]:
    image = rendered("sim", standard_camera(SIZE))[number]
    return image[0].astype(np.float32), metres(image)


@settings(max_examples=15)
@given(st.floats(0.6, 1.1), st.floats(-15, 15), st.integers(0, 11))
def test_a_global_change_of_light_is_found(slope: float, offset: float, number: int) -> None:
    image, depth = source(number)
    target = np.clip(image * slope + offset, 0, 255)
    light = relight(image, target, depth, ALL)
    assert np.abs(light.image - target).mean() < 2.5
    assert light.spread < 3


def test_light_that_varies_over_the_image_is_found() -> None:
    image, depth = source()
    target = image * np.linspace(0.7, 1.0, SIZE, dtype=np.float32)[None, :, None]
    light = relight(image, target, depth, ALL)
    same_everywhere = light.slope * image + light.offset
    errors = [np.abs(each - target).mean() for each in (light.image, same_everywhere)]
    assert errors[0] < 0.7 * errors[1]


def test_changed_content_does_not_change_the_light() -> None:
    image, depth = source()
    target = image * np.float32(0.8)
    plain = relight(image, target, depth, ALL)
    changed = target.copy()
    changed[20:40, 20:40] = (250, 30, 30)
    light = relight(image, changed, depth, ALL)
    outside = np.ones(FRAME, bool)
    outside[18:42, 18:42] = False
    assert np.abs(light.image - plain.image)[outside].mean() < 1.5
    assert light.residual[24:36, 24:36].min() > 5 * max(light.spread, 1)


def test_the_light_can_be_taken_out_again() -> None:
    image, depth = source()
    light = relight(image, np.clip(image * 0.7 + 10, 0, 255), depth, ALL)
    lit = light.applied(image)
    inner = (lit > 1) & (lit < 254)
    assert np.abs(light.removed(lit) - image)[inner].max() < 0.1


def test_black_images_and_unknown_depth_have_a_finite_light() -> None:
    black = np.zeros((*FRAME, 3), np.float32)
    light = relight(black, black, np.zeros(FRAME, np.float32), 0 * ALL)
    assert np.isfinite(light.image).all()
    assert np.isfinite(light.removed(light.image)).all()
