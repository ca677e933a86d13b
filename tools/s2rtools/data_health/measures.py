"""Numbers of each image from which faults are found, in one pass over the images of a domain."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.reader import Store

Floats = NDArray[np.float64]
_BATCH = 64
_WIDTH = 160
"""Images are measured at most this wide: noise of single pixels is no sharpness."""
_DARK, _BRIGHT = 8, 247
_CELLS, _CELL, _DIRECTIONS = (6, 8), 12, 6
"""Cells of the layout of an image, pixels of a cell, and directions of edges in a cell."""
_CONTRAST = 4.0
"""Variance of the grey values below which an image shows a blank wall, and has no sharpness."""


@dataclass(frozen=True, slots=True, eq=False)
class ImageMeasures:
    """Measures of the images of one domain, (N,) each; NaN where there is no image.

    sharpness: see the function of this name. dark, bright: shares of pixels at the ends of the
    range. change: mean absolute change of the grey values from the image before in the store.
    content: hash of the image's bytes, 0 without one. signature (N, 2): 128 bits that similar
    images share. edges (N, D): see `edge_layout`; zeros without an image. holes: share of pixels
    without valid depth. saturated: share of valid depth at the end of its range.
    """

    sharpness: Floats
    dark: Floats
    bright: Floats
    change: Floats
    content: NDArray[np.uint64]
    signature: NDArray[np.uint64]
    edges: NDArray[np.float16]
    holes: Floats
    saturated: Floats

    @classmethod
    def empty(cls, count: int) -> ImageMeasures:
        """Measures of no image of `count` instances."""
        sharpness, dark, bright, change, holes, saturated = np.full((6, count), np.nan)
        content, signatures = np.zeros(count, np.uint64), np.zeros((count, 2), np.uint64)
        edges = np.zeros((count, math.prod(_CELLS) * _DIRECTIONS), np.float16)
        return cls(sharpness, dark, bright, change, content, signatures, edges, holes, saturated)

    def measure(self, iid: int, rgb: NDArray[np.uint8], previous: Floats | None) -> Floats:
        """Measure one image (H, W, 3); returns its small grey image (h, w)."""
        grey = small_grey(rgb)
        if float(grey.var()) > _CONTRAST:
            self.sharpness[iid] = sharpness(grey)
        self.dark[iid] = float((grey <= _DARK).mean())
        self.bright[iid] = float((grey >= _BRIGHT).mean())
        if previous is not None and previous.shape == grey.shape:
            self.change[iid] = float(np.abs(grey - previous).mean())
        digest = hashlib.blake2b(np.ascontiguousarray(rgb).tobytes(), digest_size=8).digest()
        self.content[iid] = int.from_bytes(digest, "big") or 1
        self.signature[iid] = signature(grey)
        self.edges[iid] = edge_layout(grey)
        return grey

    def measure_depth(self, iid: int, raw: NDArray[np.integer], least: int, most: int) -> None:
        """Measure one raw depth image (H, W), valid within `least` .. `most`."""
        valid = (raw >= least) & (raw <= most)
        self.holes[iid] = 1.0 - float(valid.mean())
        if valid.any():
            self.saturated[iid] = float((raw[valid] == most).mean())


def small_grey(rgb: NDArray[np.uint8]) -> Floats:
    """The grey values (h, w) of an image (H, W, 3), at most `_WIDTH` pixels wide."""
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY).astype(np.float64)
    scale = _WIDTH / grey.shape[1]
    if scale < 1:
        size = _WIDTH, max(1, round(grey.shape[0] * scale))
        grey = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA))
    return grey


def sharpness(grey: Floats) -> float:
    """How much an image (h, w) loses by a blur of one pixel, which blurred images lose less by.

    The variance of its Laplacian in that of the blurred image. Source: Crété, Dolmiere, Ladret and
    Nicolas, "The blur effect: perception and estimation with a new no-reference perceptual blur
    metric", SPIE 6492, 2007.
    """
    softer = cv2.GaussianBlur(grey, (0, 0), 1.0)
    variances = (float(cv2.Laplacian(each, cv2.CV_64F).var()) for each in (grey, softer))
    own, blurred = variances
    return own / blurred if blurred > 0 else math.nan


def signature(grey: Floats) -> NDArray[np.uint64]:
    """128 bits of an image (h, w): which of 8 x 8 areas are brighter than those beside and above.

    Source: Krawetz, "Kind of like that", 2013 (difference hash).
    """
    across = np.diff(cv2.resize(grey, (9, 8), interpolation=cv2.INTER_AREA), axis=1)
    down = np.diff(cv2.resize(grey, (8, 9), interpolation=cv2.INTER_AREA), axis=0)
    return np.packbits(np.stack([across, down]) > 0).view(np.uint64)


def edge_layout(grey: Floats) -> Floats:
    """How strong the edges of each direction are in each cell of an image (h, w), (D,), length 1.

    Cells are scaled to similar contrast, so that the light of a room changes little. Source: Dalal
    and Triggs, "Histograms of oriented gradients for human detection", CVPR 2005.
    """
    rows, columns = _CELLS
    size = columns * _CELL, rows * _CELL
    even = cv2.GaussianBlur(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), (0, 0), 1.0)
    across, down = cv2.Sobel(even, cv2.CV_64F, 1, 0), cv2.Sobel(even, cv2.CV_64F, 0, 1)
    place = np.mod(np.arctan2(down, across), np.pi) / np.pi * _DIRECTIONS
    first = np.floor(place).astype(np.intp)
    weights = np.zeros((_DIRECTIONS, *even.shape))
    strength, late = np.hypot(across, down), place - first
    for direction, part in ((first, 1 - late), (first + 1, late)):
        np.put_along_axis(weights, direction[None] % _DIRECTIONS, (strength * part)[None], axis=0)
    cells = weights.reshape(_DIRECTIONS, rows, _CELL, columns, _CELL).sum(axis=(2, 4))
    sizes = np.linalg.norm(cells, axis=0)
    layout = (cells / (sizes + 0.3 * sizes.mean() + 1e-6)).ravel()
    return np.asarray(layout / max(np.linalg.norm(layout), 1e-6))


def measure_domain(store: Store, domain: str, advance: Callable[[int], None]) -> ImageMeasures:
    """Measure the images of a domain; `advance` gets the number of those that are done."""
    found, record = ImageMeasures.empty(len(store.instances)), store.domain(domain)
    previous: Floats | None = None
    for start, stop in _ranges(store, domain):
        images = store.frames(domain, start, stop)
        for iid, rgb, raw in zip(range(start, stop), images["rgb"], images["depth"], strict=True):
            follows = iid > 0 and _are_neighbours(store, iid)
            previous = found.measure(iid, rgb, previous if follows else None)
            if record.has_depth:
                found.measure_depth(iid, raw, record.depth_raw_min, record.depth_raw_max)
        advance(stop - start)
    return found


def _ranges(store: Store, domain: str) -> Iterator[tuple[int, int]]:
    for iids in store.imaged_ranges(domain):
        for start in range(iids.start, iids.stop, _BATCH):
            yield start, min(start + _BATCH, iids.stop)


def _are_neighbours(store: Store, iid: int) -> bool:
    trajectory = store.instances.trajectory
    return bool(trajectory[iid] == trajectory[iid - 1] and trajectory[iid] >= 0)
