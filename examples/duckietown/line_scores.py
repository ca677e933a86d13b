"""Scores of masks and segments against true line masks."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from examples.duckietown.line_detector import COLOURS, Bools, Segments
from examples.duckietown.road_renderer import IGNORE, OTHER, Mask

Floats = NDArray[np.float64]

REACH = 2
"""Pixels by which the true line is grown before segments are compared with it."""
_INSIDE = 0.5
"""Share of a segment's length that must lie on the grown line."""
_PLAIN_REACH = 3
"""Pixels between an invented segment and the next line or ignored pixel, at least."""


def pixel_counts(masks: dict[str, Bools], truth: Mask) -> Floats:
    """True positives, false positives and false negatives (colours, 3) outside `IGNORE`."""
    judged = truth != IGNORE
    counts = np.zeros((len(COLOURS), 3))
    for index, colour in enumerate(COLOURS):
        found, true = masks[colour][judged], (truth == index + 1)[judged]
        hits = np.count_nonzero(found & true)
        counts[index] = hits, np.count_nonzero(found) - hits, np.count_nonzero(true) - hits
    return counts


def true_colours(counts: Floats) -> Bools:
    """Which colours (colours,) have true pixels anywhere in counts (..., colours, 3)."""
    true = counts[..., 0] + counts[..., 2]
    return np.asarray(true.reshape(-1, true.shape[-1]).sum(axis=0) > 0)


def f1(counts: Floats) -> Floats:
    """F1 (...) of counts (..., 3); NaN where there is no true pixel."""
    total = 2 * counts[..., 0] + counts[..., 1] + counts[..., 2]
    known = counts[..., 0] + counts[..., 2] > 0
    return np.where(known, 2 * counts[..., 0] / np.where(known, total, 1), np.nan)


def mean_f1(counts: Floats, colours: Bools | None = None) -> Floats:
    """Mean of F1 (...) over some `colours` (colours,) of counts (..., colours, 3).

    None is the colours of `true_colours`. Which colours count follows from the truth alone, so that
    it is the same for all detectors that are compared; false detections of the other colours are
    counted by `false_pixels_of_absent`. NaN where one of the colours has no true pixel, as in a
    bootstrap sample without it.
    """
    chosen = true_colours(counts) if colours is None else colours
    if not chosen.any():
        return np.full(counts.shape[:-2], np.nan)
    return np.asarray(f1(counts)[..., chosen].mean(axis=-1))


def false_pixels_of_absent(counts: Floats, colours: Bools) -> float:
    """False pixels in counts (colours, 3) of colours that are not among the true `colours`; NaN
    where all are."""
    return float(counts[~colours, 1].sum()) if not colours.all() else float("nan")


def agreement(counts: Floats) -> float:
    """Dice coefficient of two sets of masks, from the summed counts (colours, 3) of one against the
    other: the mean over the colours that either of them has. NaN where both are empty."""
    total = 2 * counts[:, 0] + counts[:, 1] + counts[:, 2]
    known = total > 0
    return float((2 * counts[known, 0] / total[known]).mean()) if known.any() else float("nan")


def segment_counts(segments: dict[str, Segments], truth: Mask) -> Floats:
    """Counts (colours, 5) of one image: correct segments, judged segments, true pixels in reach,
    true pixels, invented segments.

    A segment is correct where more than half of its length lies on the true line of its colour
    grown by `REACH` pixels; one that lies mostly on `IGNORE` is not judged. A true pixel is in
    reach where a correct segment passes within `REACH` pixels of the edge of its line: the reach is
    measured on the line's border pixels, which are those that segments describe. A segment is
    invented where it lies on plain road, `_PLAIN_REACH` pixels away from lines and ignored pixels.
    """
    counts = np.zeros((len(COLOURS), 5))
    plain = ~_grown(truth != OTHER, _PLAIN_REACH)
    for index, colour in enumerate(COLOURS):
        true = truth == index + 1
        near = _grown(true, REACH)
        border = true & ~(cv2.erode(true.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
        drawn = np.zeros(truth.shape, dtype=np.uint8)
        for segment in segments[colour].points:
            pixels = segment_pixels(segment, truth.shape)
            if (truth[pixels] == IGNORE).mean() > _INSIDE:
                continue
            counts[index, 1] += 1
            if near[pixels].mean() > _INSIDE:
                counts[index, 0] += 1
                drawn[pixels] = 1
            if plain[pixels].all():
                counts[index, 4] += 1
        counts[index, 2] = np.count_nonzero(_grown(drawn > 0, REACH) & border)
        counts[index, 3] = np.count_nonzero(border)
    return counts


def segment_pixels(
    segment: NDArray[np.floating], shape: tuple[int, ...]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Rows and columns of the pixels of a segment x1, y1, x2, y2, clipped to the image."""
    x1, y1, x2, y2 = (float(value) for value in segment)
    count = max(2, round(max(abs(x2 - x1), abs(y2 - y1))) + 1)
    rows = np.clip(np.rint(np.linspace(y1, y2, count)), 0, shape[0] - 1).astype(np.int64)
    columns = np.clip(np.rint(np.linspace(x1, x2, count)), 0, shape[1] - 1).astype(np.int64)
    return rows, columns


def precision_recall(counts: Floats) -> tuple[Floats, Floats]:
    """Precision and recall (...) of segment counts (..., 5); NaN where nothing is judged."""
    with np.errstate(invalid="ignore", divide="ignore"):
        precision = np.where(counts[..., 1] > 0, counts[..., 0] / counts[..., 1], np.nan)
        recall = np.where(counts[..., 3] > 0, counts[..., 2] / counts[..., 3], np.nan)
    return precision, recall


def _grown(mask: Bools, reach: int) -> Bools:
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), dtype=np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)
