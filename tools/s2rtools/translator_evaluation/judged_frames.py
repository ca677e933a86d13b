"""Translations that are judged, by translators of a store or in a folder, and their frames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import Direction, Side
from s2rtools.adjustments.translation import apply_translator
from s2rtools.common.blocks import Blocks, split_into_blocks
from s2rtools.gap.instance_selection import random_blocks
from s2rtools.translation import fit_split
from s2rtools.translation.image_set import ImageSet, Rgb, image_files, read_image, resize
from s2rtools.translation.translator_file import StoredTranslator, open_stored
from s2rtools.translator_evaluation.fit_into_store import named_domains, stored_split

Iids = NDArray[np.int64]

MIN_IMAGES = 8
"""Fewest images on which a translator is judged."""
_BATCH = 16


@dataclass(frozen=True, slots=True, eq=False)
class Translation(ABC):
    """Images of domain `source` that are given the look of domain `target`.

    `fitted` are the iids whose images were used for a fit, `held_out` those that judge it.
    """

    name: str
    direction: Direction
    source: str
    target: str
    fitted: NDArray[np.int64]
    held_out: NDArray[np.int64]

    @property
    def side(self) -> Side:
        """The side whose images are translated."""
        return "sim" if self.direction == "sim2real" else "real"

    @property
    @abstractmethod
    def method(self) -> str:
        """What translated them."""

    @abstractmethod
    def translated(
        self, iids: Iids, rgb: Rgb, depth: NDArray[Any], valid: NDArray[np.bool_]
    ) -> tuple[Rgb, NDArray[Any]]:
        """Translated images (N, H, W, 3) and raw depth (N, H, W) of images of the source."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NamedTranslator(Translation):
    """A translator of a store."""

    stored: StoredTranslator

    @property
    def method(self) -> str:
        return self.stored.method

    def translated(
        self, iids: Iids, rgb: Rgb, depth: NDArray[Any], valid: NDArray[np.bool_]
    ) -> tuple[Rgb, NDArray[Any]]:
        batches = [
            apply_translator(self.stored, rgb[rows], depth[rows], valid[rows], 1.0)
            for rows in (slice(k, k + _BATCH) for k in range(0, len(rgb), _BATCH))
        ]
        translated, noisy = (np.concatenate(parts) for parts in zip(*batches, strict=True))
        return translated, noisy


def named_translator(store: Store, name: str) -> NamedTranslator:
    """A translator of a store. Raises RequestError if it is unknown, missing or damaged."""
    record, split = store.translator(name), stored_split(store, name)
    return NamedTranslator(
        name, record.direction, record.source_domain, record.target_domain,
        np.flatnonzero(split == fit_split.FITTED), np.flatnonzero(split == fit_split.HELD_OUT),
        stored=open_stored(store.path, record.sha256),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class JudgedInstances:
    """The instances on which one translator is judged, in recording order.

    `target` are those of the target's images: the same as `source` in a store with poses.
    `held_out` tells whether none of the images was used for a fit.
    """

    source: Iids
    target: Iids
    held_out: bool


@dataclass(frozen=True, slots=True, eq=False)
class JudgedFrames:
    """Frames at the stored size of instances `iids` (N,), in recording order.

    `source` and `translated` are RGB (N, H, W, 3); `target` (M, H, W, 3) shows the same poses where
    `paired`, else other places. `depth` and `translated_depth` (N, H, W) are raw values of the
    source, `valid` where they are known. `labels` name the images; `groups` (N,) are codes, equal
    for images that follow one another in a recording, or None where that is not known.
    """

    iids: Iids
    source: Rgb
    translated: Rgb
    target: Rgb
    depth: NDArray[Any]
    translated_depth: NDArray[Any]
    valid: NDArray[np.bool_]
    paired: bool
    labels: Sequence[str]
    groups: NDArray[np.int64] | None = None

    @classmethod
    def of_colours(cls, source: ImageSet, translated: Rgb, target: ImageSet) -> JudgedFrames:
        """Frames without depth of images in files, `iids` being their rows."""
        nothing = np.zeros(source.images.shape[:3])
        return cls(
            np.arange(len(source)), source.images, translated, target.images, nothing, nothing,
            nothing.astype(np.bool_), False, source.names,
        )  # fmt: skip


def judged_instances(
    store: Store,
    translators: Sequence[Translation],
    translator: Translation,
    max_images: int,
    seed: int,
) -> JudgedInstances:
    """The instances for one of several translators that are judged together.

    All of the translators hold them out, so that they are compared on the same images. Where fewer
    than `MIN_IMAGES` are held out, all instances are judged. In a data set with poses they are
    pairs, whose images are compared with each other. Of more than `max_images` whole blocks are
    drawn by `seed`. Raises RequestError for a domain with too few images.
    """
    usable = np.ones(len(store.instances), dtype=np.bool_)
    for each in translators:
        usable &= np.isin(np.arange(len(usable)), each.held_out)
    chosen, held_out = [], True
    for domain in (translator.source, translator.target):
        needed = (translator.source, translator.target) if store.has_poses else (domain,)
        imaged = store.imaged(*needed)
        if imaged.sum() < MIN_IMAGES:
            raise RequestError(
                f"{store.path}: domain {domain} has {imaged.sum()} images; judging needs "
                f"{MIN_IMAGES}"
            )
        iids = store.in_recording_order(imaged & usable)
        if iids.size < MIN_IMAGES:
            iids, held_out = store.in_recording_order(imaged), False
        chosen.append(_drawn(store, iids, max_images, seed))
    return JudgedInstances(chosen[0], chosen[1], held_out)


def _drawn(store: Store, iids: Iids, max_images: int, seed: int) -> Iids:
    """At most `max_images` of the instances, in whole blocks where possible."""
    if iids.size <= max_images:
        return iids
    rows, _ = random_blocks(instance_blocks(store, iids), max_images, seed)
    return iids[rows] if rows.size >= MIN_IMAGES else iids[:max_images]


def instance_blocks(store: Store, iids: Iids) -> Blocks:
    """Blocks of instances in recording order."""
    return split_into_blocks(store.instances.trajectory[iids])


def runs_of_neighbours(store: Store, iids: Iids) -> NDArray[np.int64]:
    """Codes (N,), equal for instances that follow one another in a recording."""
    truth = store.instances
    position = np.empty(len(truth), dtype=np.int64)
    order = store.in_recording_order(np.ones(len(truth), dtype=np.bool_))
    position[order] = np.arange(order.size)
    breaks = (np.diff(position[iids]) != 1) | (np.diff(truth.trajectory[iids]) != 0)
    return np.concatenate([[0], np.cumsum(breaks)]).astype(np.int64)


def load_frames(store: Store, translator: Translation, chosen: JudgedInstances) -> JudgedFrames:
    """Read and translate the frames of some instances."""
    source = _read(store, translator.source, chosen.source, ("rgb", "depth"))
    target = _read(store, translator.target, chosen.target, ("rgb",))
    domain = store.domain(translator.source)
    rgb, depth = source["rgb"], source["depth"]
    valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    translated, noisy = translator.translated(chosen.source, rgb, depth, valid)
    return JudgedFrames(
        iids=chosen.source,
        source=rgb,
        translated=translated,
        target=target["rgb"],
        depth=depth,
        translated_depth=noisy,
        valid=valid,
        paired=store.has_poses,
        labels=[f"instance {iid}" for iid in chosen.source.tolist()],
        groups=runs_of_neighbours(store, chosen.source),
    )


def _read(
    store: Store, domain: str, iids: Iids, images: tuple[str, ...]
) -> dict[str, NDArray[Any]]:
    """Images of some instances by runs of consecutive iids."""
    trajectory = store.instances.trajectory[iids]
    breaks = (np.diff(iids) != 1) | (np.diff(trajectory) != 0)
    runs = np.split(iids, np.flatnonzero(breaks) + 1)
    parts = [store.frames(domain, int(run[0]), int(run[-1]) + 1, images) for run in runs]
    return {image: np.concatenate([part[image] for part in parts]) for image in images}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GeneratedImages(Translation):
    """Images of a folder, each made from the source's image of an instance.

    `files` holds the file of each iid; whether what generated them was trained on these images is
    not known.
    """

    files: dict[int, Path]

    @property
    def method(self) -> str:
        return "folder"

    def translated(
        self, iids: Iids, rgb: Rgb, depth: NDArray[Any], valid: NDArray[np.bool_]
    ) -> tuple[Rgb, NDArray[Any]]:
        """The images at the size of the source's, and the depth of the source."""
        size = rgb.shape[1], rgb.shape[2]
        images = [resize(read_image(self.files[iid])[None], size) for iid in iids.tolist()]
        return np.concatenate(images), depth


def generated_images(
    store: Store, folder: Path, like: Side, domains: tuple[str, str] | None = None
) -> GeneratedImages:
    """The images of a folder and its subfolders that shall look like side `like` of a store.

    Their names are the iids of the instances, such as `17.png` or `000017.jpg`. `domains` are the
    names of the sim and the real domain. Raises RequestError for other names, for two images of an
    instance, for instances of which a domain has no image, and for fewer than `MIN_IMAGES` images.
    """
    direction: Direction = "sim2real" if like == "real" else "real2sim"
    source, target = named_domains(store, direction, domains)
    imaged = store.imaged(*((source, target) if store.has_poses else (source,)))
    files: dict[int, Path] = {}
    for path in image_files(folder):
        if not (path.stem.isascii() and path.stem.isdecimal()):
            raise RequestError(f"{path}: name it by the iid of its instance, such as 17.png")
        iid = int(path.stem)
        if iid >= len(imaged) or not imaged[iid]:
            needed = f"{source} and {target}" if store.has_poses else source
            raise RequestError(f"{path}: instance {iid} has no images of {needed} in {store.path}")
        if iid in files:
            raise RequestError(f"{path}: instance {iid} has another image, {files[iid]}")
        files[iid] = path
    if len(files) < MIN_IMAGES:
        raise RequestError(f"{folder}: {len(files)} images; judging needs {MIN_IMAGES}")
    iids = np.array(sorted(files), dtype=np.int64)
    name = folder.resolve().name
    return GeneratedImages(name, direction, source, target, iids[:0], iids, files=files)
