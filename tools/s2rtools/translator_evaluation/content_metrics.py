"""Content that a translator keeps, loses and invents: source images against translated images.

Pure functions of arrays. `source` and `translated` are (N, h, w, 3) uint8; image i of one belongs
to image i of the other. None of the metrics changes much under a map of colours, except
`luminance_correlation` and `region_correlation`, which measure whether bright stays bright.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.spatial.distance import pdist

from s2rtools.translation.image_set import Rgb
from s2rtools.translator_evaluation import image_structure as structure
from s2rtools.translator_evaluation.image_structure import GREY_FLOOR, Floats, Plane

REGIONS = 8
"""Rows and columns of the regions of `region_correlation`."""
STRONG_EDGES = 0.1
"""Share of the pixels of a source that count as its strong edges."""
COARSE = 2.5
"""Pixels: smoothing of the edges that `sharpness` compares fine edges with."""
WINDOW = 2.5
"""Pixels: Gaussian window of the local explanation of one image by another."""
UNEXPLAINED_SHARE = 0.5
"""A pixel is invented if more than this share of the variance around it is unexplained ..."""
UNEXPLAINED_CONTRAST = 0.3
"""... and its deviation exceeds this share of the contrast of the image."""
DEPTH_STEP = 0.1
"""Relative change of depth between neighbouring pixels that counts as a depth edge."""


def edge_agreement(source: Rgb, translated: Rgb) -> Floats:
    """Cosine (N,) of the edge fields (strength and orientation): 1 where all edges are kept.

    Invariant to contrast and to the sign of edges.
    """
    values = []
    for before, after in zip(source, translated, strict=True):
        a, b = structure.edge_field(before), structure.edge_field(after)
        norm = float(np.linalg.norm(a)) * float(np.linalg.norm(b))
        floor = 0.01 * GREY_FLOOR**2 * a.shape[0] * a.shape[1]
        values.append(float((a * b).sum()) / max(norm, floor))
    return np.array(values)


def luminance_correlation(source: Rgb, translated: Rgb) -> Floats:
    """Correlation (N,) of the luminance over the pixels of each image; 0 where one is flat."""
    before, after = structure.luminance(source), structure.luminance(translated)
    return np.array([_correlation(a, b) for a, b in zip(before, after, strict=True)])


def _correlation(a: Plane, b: Plane) -> float:
    a, b = a - a.mean(), b - b.mean()
    spread = np.hypot(a.std(), 0.25 * GREY_FLOOR) * np.hypot(b.std(), 0.25 * GREY_FLOOR)
    return float((a * b).mean() / spread)


def region_correlation(source: Rgb, translated: Rgb) -> Floats:
    """Rank correlation (N,) of the mean luminance of `REGIONS` x `REGIONS` regions."""
    before, after = (
        [
            cv2.resize(plane, (REGIONS, REGIONS), interpolation=cv2.INTER_AREA).ravel()
            for plane in structure.luminance(rgb)
        ]
        for rgb in (source, translated)
    )
    values = []
    for a, b in zip(before, after, strict=True):
        flat = min(np.ptp(a), np.ptp(b)) < 1e-3
        values.append(0.0 if flat else float(stats.spearmanr(a, b).statistic))
    return np.array(values)


def sharpness(source: Rgb, translated: Rgb) -> Floats:
    """Sharpness (N,) of the translated images relative to their sources: less than 1 for a blur.

    NaN where a translated image has no edges at the strong edges of its source.
    """
    values = []
    for before, after in zip(source, translated, strict=True):
        strong = _strong_edges(before)
        values.append(_edge_sharpness(after, strong) / _edge_sharpness(before, strong))
    return np.array(values)


def edge_sharpness(images: Rgb) -> Floats:
    """Sharpness (N,) at the strong edges of each image, NaN for an image without edges.

    Strength of the edges of the image over that of the image smoothed with `COARSE` pixels:
    contrast cancels, and noise counts little beside strong edges.
    """
    return np.array([_edge_sharpness(image, _strong_edges(image)) for image in images])


def _strong_edges(image: Rgb) -> NDArray[np.bool_]:
    strength = structure.edge_strength(image, COARSE)
    return np.asarray(strength >= np.quantile(strength, 1 - STRONG_EDGES))


def _edge_sharpness(image: Rgb, strong: NDArray[np.bool_]) -> float:
    coarse = float(structure.edge_strength(image, COARSE)[strong].mean())
    if coarse < 0.05:
        return float("nan")
    return float(structure.edge_strength(image, 0.0)[strong].mean()) / coarse


def diversity(source: Rgb, translated: Rgb) -> float:
    """Mean distance between two translated images over that between two source images.

    Of standardised thumbnails, so that a look common to all images does not count as collapse. NaN
    for fewer than two images and for source images that are all alike.
    """
    if len(source) < 2:
        return float("nan")
    distances = [
        pdist([structure.standardised_thumbnail(image) for image in images]).mean()
        for images in (source, translated)
    ]
    return float(distances[1] / distances[0]) if distances[0] > 1e-6 else float("nan")


@dataclass(frozen=True, slots=True)
class Pairing:
    """How well source images are recognised in their translated images.

    matched: share of translated images that resemble their own source most; rank: mean share of
    the other sources that resemble it less (0.5 by chance). NaN for fewer than two images.
    """

    matched: float
    rank: float


def pairing(source: Rgb, translated: Rgb) -> Pairing:
    """Compare the edge layout of every translated image with that of every source image."""
    count = len(source)
    if count < 2:
        return Pairing(float("nan"), float("nan"))
    before, after = (
        np.stack([structure.layout_descriptor(image) for image in images])
        for images in (source, translated)
    )
    similarity = after @ before.T
    own = np.diag(similarity)[:, None]
    others = ~np.eye(count, dtype=np.bool_)
    less = ((similarity < own - 1e-9) & others).sum(axis=1)
    equal = ((np.abs(similarity - own) <= 1e-9) & others).sum(axis=1)
    rank = (less + equal / 2) / (count - 1)
    # Equal sources share a match, and a flat image matches none.
    best = (less + equal == count - 1) / (1.0 + equal)
    return Pairing(float(best.mean()), float(rank.mean()))


def invented_regions(source: Rgb, translated: Rgb) -> Floats:
    """Area (N,) of the largest region of each translated image that its source does not explain.

    As a share of the image. A pixel is unexplained if, around it, no affine map of the source's
    colours and no blur gives the translated image: it shows edges that the source lacks. A region
    includes what its outline encloses. With the arguments exchanged: regions of the source that
    are lost.
    """
    return np.array(
        [
            largest_region(invented_mask(before, after))
            for before, after in zip(source, translated, strict=True)
        ]
    )


def invented_mask(source: Rgb, translated: Rgb) -> NDArray[np.bool_]:
    """Unexplained pixels (h, w) of one image."""
    window = max(1.5, structure.scaled(WINDOW, source.shape))
    residual, total = structure.unexplained_variance(source, translated, window)
    contrast = float(translated.reshape(-1, 3).astype(np.float64).var(axis=0).sum())
    limit = UNEXPLAINED_CONTRAST**2 * max(contrast, 3 * GREY_FLOOR**2)
    return (residual > UNEXPLAINED_SHARE * total) & (residual > limit)


def largest_region(mask: NDArray[np.bool_]) -> float:
    """Share of the image inside the outline of the largest connected region."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = 0
    for outline in outlines:
        filled = np.zeros(mask.shape, dtype=np.uint8)
        cv2.drawContours(filled, [outline], -1, 1, cv2.FILLED)
        largest = max(largest, int(filled.sum()))
    return largest / mask.size


def depth_edges(depth: NDArray[Any], valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels (h, w) at steps of depth of more than `DEPTH_STEP`, where both sides are valid.

    `depth` (h, w) is proportional to metres.
    """
    values = depth.astype(np.float64)
    edges = np.zeros(depth.shape, dtype=np.bool_)
    for depths, known, marked in ((values, valid, edges), (values.T, valid.T, edges.T)):
        first, second = depths[:-1], depths[1:]
        step = np.abs(second - first) > DEPTH_STEP * np.maximum(np.minimum(first, second), 1e-9)
        marked[:-1] |= step & known[:-1] & known[1:]
    return edges


def depth_edge_contrast(images: Rgb, edges: NDArray[np.bool_]) -> Floats:
    """How well edges of images (N, h, w, 3) show where depth edges (N, h, w) are, (N,).

    Probability that the edge strength at a pixel on or beside a depth edge exceeds that at another
    pixel (area under the ROC curve); NaN where an image has fewer than ten pixels of either kind.
    """
    values = []
    for image, marked in zip(images, edges, strict=True):
        near = cv2.dilate(marked.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.bool_)
        strength = structure.edge_strength(image).astype(np.float64)
        positive, negative = strength[near], strength[~near]
        if min(positive.size, negative.size) < 10:
            values.append(np.nan)
            continue
        above = stats.mannwhitneyu(positive, negative, method="asymptotic").statistic
        values.append(float(above / (positive.size * negative.size)))
    return np.array(values)


def flicker(source: Rgb, translated: Rgb, groups: NDArray[np.integer[Any]]) -> float:
    """Additional change between neighbouring images of a recording after translation.

    Mean absolute change of thumbnails, in units of the contrast of all thumbnails of a set, of the
    translated images minus that of the source. `groups` (N,) are codes of recordings. NaN without
    neighbours.
    """
    neighbours = np.flatnonzero(np.diff(groups) == 0)
    if not neighbours.size:
        return float("nan")
    changes = []
    for images in (source, translated):
        small = np.stack(
            [
                cv2.resize(image, (REGIONS, REGIONS), interpolation=cv2.INTER_AREA)
                for image in images.astype(np.float32)
            ]
        )
        contrast = np.hypot(small.reshape(-1, 3).std(axis=0), GREY_FLOOR)
        steps = np.abs(small[neighbours + 1] - small[neighbours]) / contrast
        changes.append(float(steps.mean()))
    return changes[1] - changes[0]
