"""Distances between translated and target images, beside controls."""

import numpy as np
import pytest

from s2rtools.common.blocks import split_into_blocks
from s2rtools.common.wasserstein import wasserstein_by_dimension
from s2rtools.translator_evaluation import distance_metrics
from s2rtools.translator_evaluation.distance_metrics import (
    channel_histograms,
    colour_features,
    histogram_distance,
)
from s2rtools.translator_evaluation.measures import CHANNELS
from tests.translator_evaluation.scenes import Images, as_images, recoloured, rooms

SOURCE = rooms(0, 24)
TARGET = recoloured(SOURCE)
BLOCKS = split_into_blocks(np.zeros(24, dtype=np.int64), 4)
FEATURES = {"colour": colour_features}


def distances(translated: Images):
    found = distance_metrics.distances(translated, SOURCE, TARGET, FEATURES, BLOCKS)
    return {(row.metric, row.reference): row.interval for row in found}


def test_distances_of_histograms_are_those_of_the_pixels():
    first, second = SOURCE[:2], TARGET[2:4]
    shares = (channel_histograms(images).mean(axis=0) for images in (first, second))
    pixels = (images.reshape(-1, 3).astype(np.float64) for images in (first, second))
    assert histogram_distance(*shares) == pytest.approx(wasserstein_by_dimension(*pixels))


def test_images_of_the_target_have_no_distance_to_it():
    found = distances(TARGET)
    assert found["kid_colour", "translator"].value == pytest.approx(0, abs=1e-12)
    assert all(found[f"w1_{name}", "translator"].value == 0 for name in CHANNELS)
    assert found["kid_colour", "identity"].value > 0


def test_a_repeated_image_covers_little_of_the_target():
    found = distances(TARGET)
    assert found["recall_colour", "repeated_image"].value < 0.4
    assert found["recall_colour", "translator"].value > 0.5


def test_intervals_hold_their_value_and_depend_on_the_seed_alone():
    first, second = distances(SOURCE), distances(SOURCE)
    for key, interval in first.items():
        assert interval.value == second[key].value
        if np.isfinite(interval.low) and "kid" in key[0]:
            assert interval.low <= interval.value <= interval.high
            assert (interval.low, interval.high) == (second[key].low, second[key].high)


def test_few_blocks_give_no_interval():
    blocks = split_into_blocks(np.zeros(8, dtype=np.int64), 4)
    found = distance_metrics.distances(SOURCE[:8], SOURCE[:8], TARGET[:8], FEATURES, blocks)
    kid = next(row for row in found if row.metric == "kid_colour" and row.reference != "target")
    assert np.isfinite(kid.interval.value)
    assert np.isnan(kid.interval.low)


def test_folders_are_compared_without_pairs():
    target = as_images(rooms(5, 14) * 0.4)
    rows = distance_metrics.distances(as_images(SOURCE[:9] * 0.4), SOURCE[:9], target, FEATURES)
    found = {(row.metric, row.reference): row.interval.value for row in rows}
    assert found["w1_red", "translator"] < found["w1_red", "identity"]
    assert found["kid_colour", "translator"] < found["kid_colour", "identity"]
    assert ("w1_red", "repeated_image") in found
    assert ("w1_red", "target") in found
