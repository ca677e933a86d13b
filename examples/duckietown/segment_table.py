"""Line segments of the images of a bag, as a table of one row per segment."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from examples.duckietown.line_detector import (
    COLOURS,
    DEFAULT_THRESHOLDS,
    Crop,
    Thresholds,
    detect,
    detector_images,
)
from s2rtools.common.result_files import write_all
from s2rtools.translation.image_set import Rgb

COLUMNS = ("stamp_ns", "colour", "x1", "y1", "x2", "y2", "normal_x", "normal_y")


class SegmentTable:
    """Collects the segments of images; positions are pixels of the detector's image, 160 x 80."""

    def __init__(self, thresholds: Thresholds = DEFAULT_THRESHOLDS, crop: Crop = "auto") -> None:
        self._thresholds, self._crop = thresholds, crop
        self._text = io.StringIO()
        self._writer = csv.writer(self._text, lineterminator="\n")
        self._writer.writerow(COLUMNS)
        self.images = self.segments = 0

    def add(self, stamp: int, rgb: Rgb) -> None:
        """Detect the segments of an image (H, W, 3) with a stamp in nanoseconds."""
        detection = detect(detector_images(rgb[None], self._crop)[0], self._thresholds)
        self.images += 1
        for colour in COLOURS:
            found = detection.segments[colour]
            for ends, normal in zip(found.points, found.normals, strict=True):
                self._writer.writerow(
                    (stamp, colour, *(f"{value:g}" for value in ends),
                     *(f"{value:.4f}" for value in normal))
                )  # fmt: skip
            self.segments += len(found)

    def write(self, path: Path) -> None:
        """Write the table as CSV. Raises RequestError."""
        write_all({path: self._text.getvalue().encode()})
