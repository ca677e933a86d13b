"""`mkl+residual`: gain over the linear map, its bound and its fallback."""

import numpy as np

from s2rtools.translation import METHODS
from s2rtools.translation.method import FitSettings
from s2rtools.translation.residual import held_out_rows, patch_distance
from tests.translation.palette_world import counterparts, difference, image_set, painted, shapes

SIZE = {"channels": "8", "blocks": "1"}


def curved(images):
    """A map that is not linear: a power curve per channel."""
    return np.rint((images / 255.0) ** np.array([0.5, 2.0, 1.5]) * 255).astype(np.uint8)


def test_paired_it_beats_the_linear_map_on_a_map_that_is_not_linear():
    images = painted(shapes(1, 60), "first", 1)
    source, target = image_set(images), image_set(curved(images))
    settings = FitSettings(steps=120, paired=True, options=SIZE)
    result = METHODS.find("mkl+residual").fit(source, target, settings)
    unseen = counterparts()[0]
    linear = METHODS.find("mkl").fit(source, target, FitSettings()).translator
    wanted = curved(unseen)
    reached = difference(result.translator.translate(unseen), wanted)
    assert reached < 0.7 * difference(linear.translate(unseen), wanted)
    assert result.facts["share"] > 0


def test_it_falls_back_to_the_linear_map_where_the_network_does_not_help():
    images = painted(shapes(1, 40), "first", 1)
    source, target = image_set(images), image_set(255 - images // 2)
    settings = FitSettings(steps=0, options=SIZE)
    result = METHODS.find("mkl+residual").fit(source, target, settings)
    train = image_set(images[:34]), image_set(target.images[:34])
    linear = METHODS.find("mkl").fit(*train, FitSettings()).translator
    assert result.facts["fallback"]
    assert difference(result.translator.translate(images), linear.translate(images)) < 0.01


def test_with_a_share_edges_of_larger_images_have_the_contrast_of_the_linear_map():
    images = painted(shapes(1, 7), "first", 1)
    source, target = image_set(images), image_set(images // 3)
    translator = (
        METHODS.find("mkl+residual").fit(source, target, FitSettings(steps=0, options=SIZE))
    ).translator
    translator.network.get_buffer("share").fill_(1.0)
    linear = METHODS.find("mkl").fit(source, target, FitSettings()).translator
    large = images[:2].repeat(2, axis=1).repeat(2, axis=2)
    changed = translator.translate(large).astype(int)
    assert np.abs(changed - linear.translate(large)).max() <= 1


def test_the_change_is_bounded():
    source, target = image_set(painted(shapes(1, 40), "first", 1)), image_set(counterparts(40)[1])
    settings = FitSettings(steps=20, options=SIZE | {"bound": "0.1"})
    translator = METHODS.find("mkl+residual").fit(source, target, settings).translator
    share = translator.network.get_buffer("share")
    images = counterparts(4)[0]
    share.fill_(1.0)
    changed = translator.translate(images).astype(int)
    share.fill_(0.0)
    assert np.abs(changed - translator.translate(images)).max() <= 0.1 * 255 + 1


def test_the_end_of_every_recording_is_held_out():
    groups = np.repeat(np.arange(3, dtype=np.int32), 20)
    chosen = held_out_rows(groups)
    assert np.flatnonzero(chosen).tolist() == [17, 18, 19, 37, 38, 39, 57, 58, 59]
    assert held_out_rows(np.arange(20, dtype=np.int32)).sum() == 3
    assert not held_out_rows(np.zeros(3, dtype=np.int32)).any()


def test_the_patch_distance_orders_sets_by_likeness():
    images, others = painted(shapes(1, 40), "first", 1), painted(shapes(2, 40), "first", 2)
    swapped = painted(shapes(1, 40), "second", 1)
    blurred = images.copy()
    blurred[:, 1:-1] = (images[:, :-2].astype(int) + images[:, 1:-1] + images[:, 2:]) // 3
    assert patch_distance(images, images) == 0
    near = patch_distance(images, others)
    assert near < patch_distance(blurred, others)
    assert near < 0.5 * patch_distance(swapped, others)
    assert patch_distance(images[:1, :8, :8], others) > 0
