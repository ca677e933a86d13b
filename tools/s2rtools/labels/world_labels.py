"""The labels of the synthetic world: the ray caster knows which object a pixel shows."""

from __future__ import annotations

from functools import lru_cache, partial
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.reader import Store
from s2rstore.records import SIDES
from s2rtools.labels.label_sources import LabelImage, LabelSource
from s2rtools.labels.write_labels import write_labels
from s2rtools.synthetic_world.dataset import WorldData

_KEPT = 1024
"""Rendered label images that are kept in memory: 32 MB of 128 x 128 pixels."""


def label_world(root: Path, command: str) -> None:
    """Store the label images of both sides of a world; each object has a value of its own."""
    for side in SIDES:
        write_labels(root, side, partial(world_source, domain=side), command)


def world_source(store: Store, domain: str) -> LabelSource:
    """The labels of a side of the world that a store was made from; RequestError for other data."""
    data, side = WorldData.of_store(store), next((s for s in SIDES if s == domain), None)
    if data is None or side is None:
        raise RequestError(f"{store.path}: {domain} is no side of the synthetic world")
    poses, camera, renderer = store.poses(domain), data.camera(side), data.renderer(side)
    names = {number: item.name for number, item in enumerate(data.world.objects, 1)}

    @lru_cache(_KEPT)  # every image is read twice
    def read(iid: int) -> LabelImage:
        views = renderer.render(poses[iid : iid + 1], camera, samples=0)
        return views.identity[0].astype(np.uint16)

    return LabelSource(names, frozenset(np.flatnonzero(store.imaged(domain)).tolist()), read)
