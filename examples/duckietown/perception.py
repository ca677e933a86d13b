"""The line detector as a model that `s2r translate report --downstream` judges translators by."""

from __future__ import annotations

import numpy as np

from examples.duckietown.line_detector import (
    COLOURS,
    DEFAULT_THRESHOLDS,
    Thresholds,
    colour_masks,
    detector_images,
    road_part,
)
from examples.duckietown.road_images import reduce_mask
from examples.duckietown.road_renderer import OTHER, Mask
from s2rtools.translation.image_set import Rgb
from s2rtools.translator_evaluation.downstream import segmentation_agreement


class LineModel:
    """Labels road, white, yellow and red; scored by mean intersection over union."""

    def __init__(self, thresholds: Thresholds = DEFAULT_THRESHOLDS) -> None:
        self.thresholds = thresholds

    def predict(self, image: Rgb) -> Mask:
        """Labels (80, 160) of a camera image."""
        masks = colour_masks(detector_images(image[None])[0], self.thresholds)
        chosen = [masks[colour] for colour in COLOURS]
        return np.select(chosen, range(1, len(COLOURS) + 1), OTHER).astype(np.uint8)

    def score(self, result: Mask, truth: Mask) -> float:
        """Agreement with a line mask of the camera image's size."""
        return segmentation_agreement(result, reduce_mask(road_part(truth[None])[0])).mean_iou


MODEL = LineModel()
