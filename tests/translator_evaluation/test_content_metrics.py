"""Metrics of the content that a translator keeps, on procedural rooms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from s2rstore.errors import RequestError
from s2rtools.translator_evaluation import content_metrics as metrics
from s2rtools.translator_evaluation.measures import measure_content
from tests.translator_evaluation.scenes import as_images, blurred, recoloured, rooms, with_object

ROOMS = rooms(0)


def test_equal_images_keep_everything():
    content = measure_content(ROOMS, ROOMS)
    assert content["edge_agreement"] == pytest.approx(1, abs=1e-6)
    assert content["luminance_correlation"] > 0.99
    assert content["region_correlation"] == pytest.approx(1)
    assert content["sharpness"] == pytest.approx(1)
    assert content["diversity"] == pytest.approx(1)
    assert (content["matched"], content["pairing_rank"]) == (1, 1)
    assert (content["invented_area"], content["lost_area"], content["inverted_share"]) == (0, 0, 0)


@settings(max_examples=12)
@given(st.floats(0.35, 1.0), st.floats(0, 60))
def test_contrast_and_brightness_do_not_count(gain, offset):
    images = ROOMS[:2]
    changed = as_images(images * gain + offset * (1 - gain))
    assert metrics.edge_agreement(images, changed).min() > 0.98
    assert metrics.luminance_correlation(images, changed).min() > 0.97
    assert np.abs(metrics.sharpness(images, changed) - 1).max() < 0.06
    assert metrics.invented_regions(images, changed).max() == 0


def test_inverted_images_have_the_same_edges_and_opposite_luminance():
    inverted = 255 - ROOMS
    assert metrics.edge_agreement(ROOMS, inverted).min() > 0.99
    assert metrics.luminance_correlation(ROOMS, inverted).max() < -0.95
    assert metrics.region_correlation(ROOMS, inverted).max() < -0.95


def test_flat_images_have_no_correlation_and_no_sharpness():
    flat = np.full_like(ROOMS, 90)
    assert np.abs(metrics.luminance_correlation(ROOMS, flat)).max() == 0
    assert (metrics.region_correlation(ROOMS, flat) == 0).all()
    assert np.isnan(metrics.sharpness(ROOMS, flat)).all()
    assert metrics.diversity(ROOMS, flat) == 0


def test_equal_sources_share_a_match():
    twice = np.concatenate([ROOMS[:3], ROOMS[:3]])
    found = metrics.pairing(twice, twice)
    assert found.matched == pytest.approx(0.5)
    assert found.rank == pytest.approx(1 - 0.5 / 5)


@pytest.mark.parametrize("size", [8, 12, 20, 32])
def test_the_region_of_a_pasted_object_grows_with_it(size):
    areas = metrics.invented_regions(recoloured(ROOMS), recoloured(with_object(ROOMS, size)))
    true = size**2 / (ROOMS.shape[1] * ROOMS.shape[2])
    assert np.median(areas) >= 0.5 * true
    assert (areas >= 0.005).all()
    assert np.median(areas) <= 1.5 * (size + 10) ** 2 / (ROOMS.shape[1] * ROOMS.shape[2])


def test_a_removed_object_is_lost_and_a_blur_invents_nothing():
    assert np.median(metrics.invented_regions(with_object(ROOMS, 16), ROOMS)) > 0
    lost = measure_content(with_object(ROOMS, 16), ROOMS)["lost_area"]
    assert lost > 0.015
    assert metrics.invented_regions(ROOMS, blurred(ROOMS, 2.0)).max() < 0.005


def test_enclosed_pixels_belong_to_a_region():
    ring = np.zeros((20, 30), dtype=bool)
    ring[5:15, 5:15] = True
    ring[7:13, 7:13] = False
    assert metrics.largest_region(ring) == pytest.approx(100 / 600)
    assert metrics.largest_region(np.zeros((4, 4), dtype=bool)) == 0


def test_depth_edges_lie_at_steps_of_valid_depth():
    depth = np.full((12, 12), 2.0)
    depth[:, 6:] = 3.0
    valid = np.ones(depth.shape, dtype=bool)
    valid[:3] = False
    edges = metrics.depth_edges(depth, valid)
    assert edges[3:, 5].all()
    assert edges.sum() == 9
    assert not metrics.depth_edges(np.linspace(1, 1.2, 144).reshape(12, 12), valid).any()


def test_lost_outlines_at_depth_edges_lower_their_contrast():
    depth = np.full(ROOMS.shape[1:3], 3.0)
    depth[30:70, 40:90] = 1.5
    valid = np.ones(depth.shape, dtype=bool)
    marked = np.broadcast_to(metrics.depth_edges(depth, valid), ROOMS.shape[:3])
    shown = ROOMS.copy()
    shown[:, 30:70, 40:90] = 255 - shown[:, 30:70, 40:90] // 3
    kept = measure_content(shown, recoloured(shown), edges=marked)["depth_edges_kept"]
    lost = measure_content(shown, blurred(shown, 12), edges=marked)["depth_edges_kept"]
    assert kept == pytest.approx(1, abs=0.1)
    assert lost < kept


def test_flicker_is_the_change_that_the_translator_adds():
    groups = np.array([0] * 5 + [1] * 5)
    steady = np.repeat(ROOMS[:1], 10, axis=0)
    levels = np.where(np.arange(10) % 2 == 0, 0.7, 1.0)[:, None, None, None]
    assert metrics.flicker(steady, steady, groups) == 0
    assert metrics.flicker(steady, as_images(steady * levels), groups) > 0.2
    assert abs(metrics.flicker(ROOMS, recoloured(ROOMS), groups)) < 0.15
    assert np.isnan(metrics.flicker(ROOMS, ROOMS, np.arange(10)))


def test_different_shapes_and_no_images_are_refused():
    with pytest.raises(RequestError, match="shape"):
        measure_content(ROOMS, ROOMS[:, :40])
    with pytest.raises(RequestError, match="no images"):
        measure_content(ROOMS[:0], ROOMS[:0])
