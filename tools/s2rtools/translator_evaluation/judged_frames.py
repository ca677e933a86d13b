"""The frames of a store on which a translator is judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.metrics.bootstrap import Blocks, split_into_blocks
from s2rstore.reader import Store
from s2rtools.adjustments.translation import apply_translator
from s2rtools.gap.instance_selection import random_blocks
from s2rtools.translation.image_set import Rgb
from s2rtools.translator_evaluation.named_translator import NamedTranslator

Iids = NDArray[np.int64]

MIN_IMAGES = 8
"""Fewest images on which a translator is judged."""
_BATCH = 16


@dataclass(frozen=True, slots=True, eq=False)
class JudgedFrames:
    """Frames at the stored size of instances `iids` (N,), in recording order.

    `source`, `translated` and `target` are RGB (N, H, W, 3), the target at the same pose; `depth`
    and `translated_depth` (N, H, W) are raw values of the source, `valid` where they are known.
    """

    iids: Iids
    source: Rgb
    translated: Rgb
    target: Rgb
    depth: NDArray[Any]
    translated_depth: NDArray[Any]
    valid: NDArray[np.bool_]


def judged_instances(
    store: Store, translators: list[NamedTranslator], max_images: int, seed: int
) -> tuple[Iids, bool]:
    """The instances that no translator was fitted on, and whether they are held out.

    Where fewer than `MIN_IMAGES` are held out, all instances are judged. Of more than `max_images`
    whole blocks are drawn by `seed`. Raises RequestError for a store with too few instances.
    """
    count = len(store.instances)
    fitted = np.zeros(count, dtype=np.bool_)
    for translator in translators:
        fitted[translator.fitted] = True
    iids = np.flatnonzero(~fitted)
    held_out = iids.size >= MIN_IMAGES
    if not held_out:
        iids = np.arange(count)
    if iids.size < MIN_IMAGES:
        raise RequestError(f"{store.path}: {count} instances; judging needs {MIN_IMAGES}")
    if iids.size > max_images:
        rows, _ = random_blocks(instance_blocks(store, iids), max_images, seed)
        iids = iids[rows] if rows.size >= MIN_IMAGES else iids[:max_images]
    return iids, held_out


def instance_blocks(store: Store, iids: Iids) -> Blocks:
    """Blocks of instances for the bootstrap."""
    return split_into_blocks(store.instances.trajectory[iids])


def runs_of_neighbours(store: Store, iids: Iids) -> NDArray[np.int64]:
    """Codes (N,), equal for instances that follow one another in a recording."""
    trajectory = store.instances.trajectory[iids]
    breaks = (np.diff(iids) != 1) | (np.diff(trajectory) != 0)
    return np.concatenate([[0], np.cumsum(breaks)]).astype(np.int64)


def load_frames(store: Store, translator: NamedTranslator, iids: Iids) -> JudgedFrames:
    """Read and translate the frames of some instances."""
    source = _read(store, translator.source, iids, ("rgb", "depth"))
    target = _read(store, translator.target, iids, ("rgb",))
    domain = store.domain(translator.source)
    rgb, depth = source["rgb"], source["depth"]
    valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    batches = [
        apply_translator(
            translator.stored, rgb[k : k + _BATCH], depth[k : k + _BATCH], valid[k : k + _BATCH], 1
        )
        for k in range(0, len(iids), _BATCH)
    ]
    translated, noisy = (np.concatenate(parts) for parts in zip(*batches, strict=True))
    return JudgedFrames(iids, rgb, translated, target["rgb"], depth, noisy, valid)


def _read(
    store: Store, domain: str, iids: Iids, images: tuple[str, ...]
) -> dict[str, NDArray[Any]]:
    """Images of some instances by runs of consecutive iids."""
    runs = np.split(iids, np.flatnonzero(np.diff(iids) != 1) + 1)
    parts = [store.frames(domain, int(run[0]), int(run[-1]) + 1, images) for run in runs]
    return {image: np.concatenate([part[image] for part in parts]) for image in images}
