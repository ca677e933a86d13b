"""Distance between translated images and images of the target domain, beside controls.

References of every distance: the translator; `identity`, the source as it is; `repeated_image`, one
image of the target in place of every translated image; `target`, two halves of the target. A
distance that a repeated image wins says little about a translator. All compare images of different
blocks, because images of one place are alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.intervals import Interval, linear
from s2rtools.common.blocks import Blocks
from s2rtools.gap.instance_selection import random_halves
from s2rtools.gap.visual.feature_distances import NEIGHBOURS, block_mmd, kernel_distance, prdc
from s2rtools.translation.image_set import Rgb
from s2rtools.translator_evaluation.image_structure import Floats
from s2rtools.translator_evaluation.measures import CHANNELS, MetricRow, figure

COLOUR_GRID = 4
SPLITS = 8
Features = Callable[[Rgb], Floats]


def colour_features(images: Rgb) -> Floats:
    """Mean colours of `COLOUR_GRID` x `COLOUR_GRID` cells and deviations of the channels, (N, d).

    In units of 64 grey levels around middle grey.
    """
    rows = []
    for image in images.astype(np.float32):
        cells = cv2.resize(image, (COLOUR_GRID, COLOUR_GRID), interpolation=cv2.INTER_AREA)
        deviations = image.reshape(-1, 3).std(axis=0)
        rows.append(np.concatenate([(cells.ravel() - 127.5) / 64, deviations / 64]))
    return np.array(rows, dtype=np.float64)


def channel_histograms(images: Rgb) -> Floats:
    """Shares of the grey levels of each channel of each image, (N, 3, 256)."""
    shares = np.empty((len(images), 3, 256))
    for row, image in enumerate(images):
        for channel in range(3):
            counts = np.bincount(image[..., channel].ravel(), minlength=256)
            shares[row, channel] = counts / counts.sum()
    return shares


def histogram_distance(first: Floats, second: Floats) -> Floats:
    """Wasserstein-1 distance (..., 3) of histograms (..., 3, 256), grey levels."""
    return np.asarray(np.abs(np.cumsum(first - second, axis=-1)).sum(axis=-1))


def distances(
    translated: Rgb,
    source: Rgb,
    target: Rgb,
    features: Mapping[str, Features],
    blocks: Blocks | None = None,
    seed: int = 1,
) -> list[MetricRow]:
    """Distances of the translator, then those of the controls.

    `source` and `translated` are (N, H, W, 3), `target` (M, H, W, 3). `features` are functions by
    name, such as `colour_features`. With `blocks` all images show the poses of the same instances
    in recording order; without them, distances have no intervals, and nothing tells which images
    show one place, so that neither precision nor recall is measured.
    """
    repeated = np.broadcast_to(target[len(target) // 2], source.shape)
    halves = _random_halves(len(target), seed)
    if blocks is not None:
        halves = random_halves(blocks, SPLITS, seed)
    known = {name: compute(target) for name, compute in features.items()}
    shares = channel_histograms(target)
    rows: list[MetricRow] = []
    for reference, images in (
        ("translator", translated), ("identity", source), ("repeated_image", repeated),
    ):  # fmt: skip
        of_images = channel_histograms(images)
        w1: Iterable[Interval | float]
        if blocks is None:
            w1 = histogram_distance(of_images.mean(axis=0), shares.mean(axis=0))
        else:
            w1 = _channel_intervals(of_images, shares, blocks)
        for name, compute in features.items():
            values = compute(images)
            if blocks is None:
                distance = kernel_distance(values, known[name])
                rows.append(figure(f"kid_{name}", distance, reference))
            else:
                interval = block_mmd(values, known[name], blocks).interval()
                rows.append(figure(f"kid_{name}", interval, reference))
                rows += _prdc(name, reference, values, known[name], halves)
        rows += [
            figure(f"w1_{channel}", value, reference)
            for channel, value in zip(CHANNELS, w1, strict=True)
        ]
    return rows + _target_against_target(known, shares, halves)


def _random_halves(count: int, seed: int) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Rows of random halves of images; none of fewer than four."""
    rng, half = np.random.default_rng(seed), count // 2
    orders = [rng.permutation(count) for _ in range(SPLITS if half >= 2 else 0)]
    return [(order[:half], order[half : 2 * half]) for order in orders]


def _prdc(
    name: str,
    reference: str,
    values: Floats,
    target: Floats,
    halves: list[tuple[NDArray[np.int64], NDArray[np.int64]]],
) -> list[MetricRow]:
    """Precision and recall, means over halves that show different poses."""
    if halves[0][0].size <= NEIGHBOURS:
        return []
    found = [prdc(target[a], values[b]) for a, b in halves]
    return [
        figure(f"{metric}_{name}", np.mean(each), reference)
        for metric, each in (
            ("precision", [p.precision for p in found]),
            ("recall", [p.recall for p in found]),
        )
    ]


def _channel_intervals(shares: Floats, target: Floats, blocks: Blocks) -> list[Interval]:
    """W1 per channel of the pixels of all images."""
    difference = np.cumsum(shares - target, axis=-1)  # (N, 3, 256)
    mean = difference.mean(axis=0)
    influence = ((difference - mean) * np.sign(mean)).sum(axis=-1)
    trajectory = np.repeat(blocks.trajectory, np.diff(blocks.start))
    values = np.abs(mean).sum(axis=-1)
    return [
        linear(float(value), column, trajectory).clipped(0.0, 255.0)
        for value, column in zip(values, influence.T, strict=True)
    ]


def _target_against_target(
    known: Mapping[str, Floats],
    shares: Floats,
    halves: list[tuple[NDArray[np.int64], NDArray[np.int64]]],
) -> list[MetricRow]:
    """Halves of the target: means over the splits, without intervals."""
    rows: list[MetricRow] = []
    if not halves:
        return rows
    for name, values in known.items():
        kid = [kernel_distance(values[a], values[b]) for a, b in halves]
        rows.append(figure(f"kid_{name}", np.mean(kid), "target"))
        rows += _prdc(name, "target", values, values, halves)
    w1 = np.array([
        histogram_distance(shares[a].mean(axis=0), shares[b].mean(axis=0)) for a, b in halves
    ])  # fmt: skip
    return rows + [
        figure(f"w1_{channel}", value, "target")
        for channel, value in zip(CHANNELS, w1.mean(axis=0), strict=True)
    ]
