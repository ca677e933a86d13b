"""Tune the HSV ranges of a line detector on labelled images.

A range is a box in HSV. Boxes are searched on a histogram of the labelled pixels: its integral
gives the F1 of any box in constant time, so that both bounds of an axis are optimised exactly while
the others are held fixed, from several starts, until nothing improves. Where many boxes are equally
good, the best one for other images is in their middle: each bound is moved to the middle of its
plateau, the interval in which F1 is within `TOLERANCE` of the best.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from examples.duckietown.line_detector import (
    COLOURS,
    DEFAULT_THRESHOLDS,
    Bounds,
    HsvRange,
    Thresholds,
)
from examples.duckietown.road_renderer import IGNORE, Mask
from s2rstore.errors import RequestError
from s2rtools.translation.image_set import Rgb

Floats = NDArray[np.float64]
Box = list[list[int]]
"""The first and the last bin, both included, for each of hue, saturation and value."""

TOLERANCE = 0.005
STEPS = (2, 4, 4)
"""Width of a bin in hue, saturation and value."""
BINS = (90, 64, 64)
_AXES = ("hue", "saturation", "value")
_HUE_SHIFT = {"white": 0, "yellow": 30, "red": 45}
"""Bins by which hues are rotated, so that a colour's range lies in the middle of the scale."""
_OPEN_LOW = {"white": (True, True, False)}
_OPEN_HIGH = {"white": (True, False, True)}
_CENTRED_PASSES = 3


@dataclass(frozen=True, slots=True)
class TunedRange:
    """A range with its F1 on the images of the tuning, and the width of the plateau of each bound
    in units of HSV: (lower, upper) per axis."""

    range: HsvRange
    f1: float
    plateau: dict[str, tuple[int, int]]


@dataclass(frozen=True, slots=True)
class Tuning:
    """Tuned ranges by colour; a colour without labelled pixels keeps its default range and is named
    in `untuned`."""

    ranges: dict[str, TunedRange]
    untuned: tuple[str, ...]
    images: int

    @property
    def thresholds(self) -> Thresholds:
        return {
            colour: self.ranges[colour].range if colour in self.ranges else default
            for colour, default in DEFAULT_THRESHOLDS.items()
        }


def tune(images: Rgb, masks: Mask, min_pixels: int = 20) -> Tuning:
    """Ranges for images (N, H, W, 3) with masks (N, H, W).

    Raises RequestError where no colour has `min_pixels` labelled pixels.
    """
    if not len(images):
        raise RequestError("tuning: no labelled images")
    judged = masks != IGNORE
    hsv = np.stack([cv2.cvtColor(image, cv2.COLOR_RGB2HSV) for image in images])[judged]
    labels = masks[judged]
    ranges, untuned = {}, []
    for index, colour in enumerate(COLOURS):
        true = labels == index + 1
        if np.count_nonzero(true) < min_pixels:
            untuned.append(colour)
        else:
            ranges[colour] = _tuned_range(colour, hsv, true)
    if not ranges:
        raise RequestError("tuning: the masks contain no line pixels")
    return Tuning(ranges, tuple(untuned), len(images))


def _tuned_range(colour: str, hsv: Rgb, true: NDArray[np.bool_]) -> TunedRange:
    shift = _HUE_SHIFT[colour]
    search = _Search(_histogram(hsv[true], shift), _histogram(hsv[~true], shift))
    best = max((search.climb(box) for box in _starts(colour, search)), key=search.score)
    centred = search.centre(best, colour)
    plateau = {
        name: tuple(
            (high - low + 1) * STEPS[axis]
            for low, high in (search.plateau(centred, axis, side, TOLERANCE) for side in (0, 1))
        )
        for axis, name in enumerate(_AXES)
    }
    return TunedRange(_to_range(centred, shift), search.score(centred), plateau)  # type: ignore[arg-type]


def _histogram(hsv: Rgb, shift: int) -> Floats:
    """Counts of pixels (n, 3) in bins, hue rotated by `shift` bins."""
    bins = [
        np.minimum(hsv[:, axis] // STEPS[axis], BINS[axis] - 1).astype(np.int64)
        for axis in range(3)
    ]
    bins[0] = (bins[0] + shift) % BINS[0]
    flat = np.ravel_multi_index(tuple(bins), BINS)
    return np.bincount(flat, minlength=int(np.prod(BINS))).reshape(BINS).astype(np.float64)


class _Search:
    """F1 of boxes on the histograms of true and other pixels."""

    def __init__(self, true: Floats, other: Floats) -> None:
        self.total = true.sum()
        self._true, self._all = (
            np.pad(counts, ((1, 0),) * 3).cumsum(0).cumsum(1).cumsum(2)
            for counts in (true, true + other)
        )
        self.marginals = [
            true.sum(axis=tuple(other for other in range(3) if other != axis)).cumsum()
            for axis in range(3)
        ]

    def _along(self, box: Box, axis: int) -> tuple[Floats, Floats]:
        """Cumulative counts (bins + 1,) of true and of all pixels along an axis inside the box's
        other two bounds."""
        (b, c) = (other for other in range(3) if other != axis)
        results = []
        for integral in (self._true, self._all):
            moved = np.moveaxis(integral, (axis, b, c), (0, 1, 2))
            low_b, high_b, low_c, high_c = box[b][0], box[b][1] + 1, box[c][0], box[c][1] + 1
            results.append(
                moved[:, high_b, high_c] - moved[:, low_b, high_c]
                - moved[:, high_b, low_c] + moved[:, low_b, low_c]
            )  # fmt: skip
        return results[0], results[1]

    def score(self, box: Box) -> float:
        """F1 of a box."""
        true, found = self._along(box, 0)
        low, high = box[0][0], box[0][1] + 1
        return float(2 * (true[high] - true[low]) / (found[high] - found[low] + self.total))

    def climb(self, box: Box) -> Box:
        """The box that no change of one axis improves."""
        box = [list(bounds) for bounds in box]
        before = -1.0
        while (now := self.score(box)) > before + 1e-9:
            before = now
            for axis in range(3):
                true, found = self._along(box, axis)
                hits = true[None, 1:] - true[:-1, None]
                inside = np.maximum(found[None, 1:] - found[:-1, None], 0)
                f1 = 2 * hits / (inside + self.total)
                low, high = np.unravel_index(int(f1.argmax()), f1.shape)
                box[axis] = [int(low), int(high)]
        return box

    def plateau(self, box: Box, axis: int, side: int, tolerance: float) -> tuple[int, int]:
        """First and last bin of one bound in which F1 stays within `tolerance`, without a gap."""
        true, found = self._along(box, axis)
        if side == 0:
            hits, all_found = (
                true[box[axis][1] + 1] - true[:-1],
                found[box[axis][1] + 1] - found[:-1],
            )
            allowed = range(box[axis][1] + 1)
        else:
            hits, all_found = true[1:] - true[box[axis][0]], found[1:] - found[box[axis][0]]
            allowed = range(box[axis][0], BINS[axis])
        f1 = 2 * hits / (np.maximum(all_found, 0) + self.total)
        limit = f1[box[axis][side]] - tolerance
        low = high = box[axis][side]
        while low - 1 in allowed and f1[low - 1] >= limit:
            low -= 1
        while high + 1 in allowed and f1[high + 1] >= limit:
            high += 1
        return low, high

    def centre(self, box: Box, colour: str) -> Box:
        """Move each bound to the middle of its plateau, never more than `TOLERANCE` below the
        best F1. A bound that natural variation cannot exceed stays open where its plateau reaches
        the end of the scale: the brightest and most saturated colours, and white's hue."""
        box = [list(bounds) for bounds in box]
        best = self.score(box)
        open_low = _OPEN_LOW.get(colour, (False, False, False))
        open_high = _OPEN_HIGH.get(colour, (False, True, True))
        for _ in range(_CENTRED_PASSES):
            for axis in range(3):
                for side in (0, 1):
                    slack = max(0.0, TOLERANCE - (best - self.score(box)))
                    low, high = self.plateau(box, axis, side, slack)
                    if side == 0 and open_low[axis] and low == 0:
                        box[axis][0] = 0
                    elif side == 1 and open_high[axis] and high == BINS[axis] - 1:
                        box[axis][1] = high
                    else:
                        box[axis][side] = (low + high) // 2
        return box


def _starts(colour: str, search: _Search) -> list[Box]:
    """The default range and boxes around the middle 80, 95 and 100 % of the true pixels."""
    default = DEFAULT_THRESHOLDS[colour]
    shift = _HUE_SHIFT[colour]
    first: Box = []
    for axis in range(3):
        low, high = default.low[axis] // STEPS[axis], default.high[axis] // STEPS[axis]
        if axis == 0 and colour != "white":
            low, high = (low + shift) % BINS[0], (high + shift) % BINS[0]
        first.append([min(low, BINS[axis] - 1), min(high, BINS[axis] - 1)])
    starts = [first]
    for tail in (0.1, 0.025, 0.0):
        box = []
        for axis in range(3):
            rising = search.marginals[axis] / search.total
            low = int(np.searchsorted(rising, tail, side="right"))
            high = int(np.searchsorted(rising, 1 - tail))
            box.append([min(low, BINS[axis] - 1), max(low, min(high, BINS[axis] - 1))])
        starts.append(box)
        starts.append([[0, BINS[0] - 1] if axis == 0 else box[axis] for axis in range(3)])
    return starts


def _to_range(box: Box, shift: int) -> HsvRange:
    low = [box[axis][0] * STEPS[axis] for axis in range(3)]
    high = [box[axis][1] * STEPS[axis] + STEPS[axis] - 1 for axis in range(3)]
    if box[0] == [0, BINS[0] - 1]:
        low[0], high[0] = 0, 180
    else:
        low[0] = (box[0][0] - shift) % BINS[0] * STEPS[0]
        high[0] = (box[0][1] - shift) % BINS[0] * STEPS[0] + STEPS[0] - 1
    return HsvRange(_bounds(low), _bounds(high))


def _bounds(values: list[int]) -> Bounds:
    return values[0], values[1], values[2]


def tuning_document(tuning: Tuning) -> dict[str, Any]:
    """Ranges, F1 on the images of the tuning and widths of the plateaus."""
    ranges = {
        colour: {
            "low": list(of.range.low), "high": list(of.range.high), "f1": round(of.f1, 4),
            "plateau": {axis: list(widths) for axis, widths in of.plateau.items()},
        }
        for colour, of in tuning.ranges.items()
    }  # fmt: skip
    return {"images": tuning.images, "ranges": ranges, "untuned": list(tuning.untuned)}


def tuning_yaml(tuning: Tuning) -> str:
    """The `colors` parameter of the line detector; a hue range over 180 becomes two ranges."""
    lines = [f"# tuned on {tuning.images} images; hue 0 .. 180, saturation and value 0 .. 255"]
    lines.append("colors:")
    for colour in COLOURS:
        lines.append(f"  {colour.upper()}:")
        if colour in tuning.ranges:
            of = tuning.ranges[colour]
            widths = "; ".join(f"{axis} {low}, {high}" for axis, (low, high) in of.plateau.items())
            lines.append(f"    # F1 {of.f1:.3f}; plateau of the lower and upper bounds: {widths}")
        else:
            lines.append("    # default: no labelled pixels")
        boxes = tuning.thresholds[colour].boxes()
        numbered = len(boxes) > 1 or len(DEFAULT_THRESHOLDS[colour].boxes()) > 1
        for number, (low, high) in enumerate(boxes, start=1):
            suffix = f"_{number}" if numbered else ""
            lines.append(f"    low{suffix}: {list(low)}")
            lines.append(f"    high{suffix}: {list(high)}")
    return "\n".join(lines) + "\n"
