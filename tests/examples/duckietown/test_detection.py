"""Detector, scores, tuning and lane pose."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples.duckietown.line_detector import (
    DEFAULT_THRESHOLDS,
    Segments,
    detect,
    detector_images,
    road_part,
)
from examples.duckietown.line_scores import f1, mean_f1, pixel_counts, segment_counts
from examples.duckietown.perception import LineModel
from examples.duckietown.tuning import tune
from s2rstore.errors import RequestError

PAINT = {1: (230, 230, 230), 2: (230, 215, 20), 3: (200, 20, 30)}


def painted(seed: int = 0, count: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Grey images (n, 80, 160, 3) with a vertical stripe of each colour, and their masks."""
    rng = np.random.default_rng(seed)
    masks = np.zeros((count, 80, 160), dtype=np.uint8)
    images = rng.integers(60, 80, (count, 80, 160, 1)).repeat(3, axis=3)
    for label, colour in PAINT.items():
        masks[:, :, 40 * label : 40 * label + 10] = label
        noise = rng.integers(-10, 11, (count, 80, 10, 3))
        images[:, :, 40 * label : 40 * label + 10] = np.array(colour) + noise
    return np.clip(images, 0, 255).astype(np.uint8), masks


def test_whole_camera_images_lose_the_upper_third_and_wide_ones_nothing():
    assert road_part(np.zeros((1, 480, 640, 3), np.uint8)).shape == (1, 320, 640, 3)
    assert road_part(np.zeros((1, 320, 640, 3), np.uint8)).shape == (1, 320, 640, 3)
    assert detector_images(np.zeros((2, 480, 640, 3), np.uint8)).shape == (2, 80, 160, 3)
    with pytest.raises(RequestError, match="crop"):
        road_part(np.zeros((1, 4, 4, 3), np.uint8), "left")  # type: ignore[arg-type]


def test_default_thresholds_find_painted_stripes_with_normals_into_them():
    images, masks = painted()
    found = detect(images[0], DEFAULT_THRESHOLDS)
    counts = pixel_counts(found.masks, masks[0])
    assert mean_f1(counts) > 0.95
    for label, colour in enumerate(("white", "yellow", "red"), start=1):
        segments = found.segments[colour]
        assert len(segments)
        middles = segments.points.reshape(-1, 2, 2).mean(axis=1)[:, 0]
        into = np.sign(40 * label + 4.5 - middles)
        outer = np.abs(middles - (40 * label + 4.5)) > 3
        upright = np.abs(segments.normals[:, 0]) > 0.9
        assert (np.sign(segments.normals[:, 0]) == into)[outer & upright].mean() > 0.9


def test_pixel_scores_ignore_255_and_leave_out_absent_colours():
    truth = np.array([[1, 1, 0, 255]], dtype=np.uint8)
    masks = {
        "white": np.array([[True, False, True, True]]),
        "yellow": np.zeros((1, 4), bool),
        "red": np.array([[False, False, True, False]]),
    }
    counts = pixel_counts(masks, truth)
    assert counts[0].tolist() == [1, 1, 1]
    assert f1(counts)[0] == 0.5
    assert np.isnan(f1(counts)[1:]).all()
    assert mean_f1(counts) == 0.5
    assert np.isnan(mean_f1(np.zeros((3, 3))))


def test_segments_count_as_correct_invented_or_not_judged():
    truth = np.zeros((80, 160), dtype=np.uint8)
    truth[:, 40:48] = 1
    truth[:, 120:] = 255
    points = np.array([[40, 5, 40, 60], [80, 5, 80, 40], [140, 5, 140, 40]], dtype=np.float32)
    some = Segments(points, np.tile(np.float32([1, 0]), (3, 1)))
    none = Segments(points[:0], np.zeros((0, 2), np.float32))
    counts = segment_counts({"white": some, "yellow": none, "red": none}, truth)
    correct, judged, reached, border, invented = counts[0]
    assert (correct, judged, invented) == (1, 2, 1)
    assert 0.3 < reached / border < 0.5


@settings(max_examples=5)
@given(st.integers(0, 1000))
def test_tuning_recovers_painted_colours_and_centres_the_bounds(seed):
    images, masks = painted(seed, 2)
    tuning = tune(images, masks)
    for colour in ("white", "yellow", "red"):
        assert tuning.ranges[colour].f1 > 0.99
    low = tuning.ranges["white"].range.low[2]
    assert 110 < low < 190
    assert tuning.ranges["white"].plateau["value"][0] > 60
    assert tuning.ranges["yellow"].range.high[1:] == (255, 255)


def test_the_detector_is_a_model_that_is_scored_by_the_agreement_of_its_labels():
    images, masks = painted()
    model = LineModel()
    result = model.predict(images[0])
    assert set(np.unique(result)) == {0, 1, 2, 3}
    assert 0.9 < model.score(result, masks[0]) <= 1
    assert model.score(model.predict(images[0] // 3), masks[0]) < 0.5
