"""A data set of torch over the images and poses of a store, for training programs of others."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.language import evaluation
from s2rstore.reader import Store
from s2rstore.records import SPLITS, Split
from s2rtools.training.splits import split_by_blocks, split_by_recording

Sample = dict[str, Any]


class StoreDataset(Dataset[Sample]):
    """The images of one domain of a store with their true poses, in the order of their iids.

    A sample has `iid`; `image` (3, H, W) float32, 0 .. 1; `pose` (3,) float32: x and y in metres,
    heading in radians; and, in a domain with depth, `depth` (H, W) float32 in metres, NaN where it
    is unknown. `transform` gets a sample and returns what the data set gives. Workers of a
    `DataLoader` open the store themselves; a fork closes it first, and the next sample opens it.
    """

    def __init__(
        self,
        store: str | Path,
        domain: str,
        split: Split | None = None,
        select: str = "all",
        transform: Callable[[Sample], Any] | None = None,
    ) -> None:
        """`split` is train, validation or test by the rules of `s2r train`; None for all images.

        `select` is an expression; instances that a run of the store was trained on are included.
        Raises RequestError for an unknown domain or split, and a data set without poses.
        """
        self._path, self._domain, self._transform = str(store), domain, transform
        self._opened: Store | None = None
        opened = self._store()
        record = opened.domain(domain)
        opened.require_poses("a data set")
        chosen = opened.imaged(domain) & evaluation.select(opened, select, with_trained=True)
        if split is not None:
            rule = split_by_blocks if record.kind == "sim" else split_by_recording
            imaged = np.flatnonzero(opened.imaged(domain))
            codes = rule(opened.instances.trajectory[imaged])
            chosen[imaged[codes != _code(split)]] = False
        self._has_depth = record.has_depth
        self.iids: NDArray[np.intp] = np.flatnonzero(chosen)

    def __len__(self) -> int:
        return len(self.iids)

    def __getitem__(self, index: int) -> Any:
        store, iid = self._store(), int(self.iids[index])
        frame, record = store.frame(self._domain, iid), store.domain(self._domain)
        pose = store.poses(self._domain)[iid].astype(np.float32)
        image = torch.from_numpy(np.ascontiguousarray(frame.rgb.transpose(2, 0, 1))).float() / 255
        sample: Sample = {"iid": iid, "image": image, "pose": torch.from_numpy(pose)}
        if self._has_depth:
            metres = np.where(frame.valid, frame.depth * record.depth_scale, np.nan)
            sample["depth"] = torch.from_numpy(metres.astype(np.float32))
        return sample if self._transform is None else self._transform(sample)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_opened": None}

    def close(self) -> None:
        """Close the store in this process; the next sample opens it again."""
        if self._opened is not None:
            self._opened.close()
        self._opened = None

    def _store(self) -> Store:
        if self._opened is None:
            self._opened = s2rstore.open(self._path)
            _WITH_STORE.add(self)
        return self._opened


_WITH_STORE: WeakSet[StoreDataset] = WeakSet()
"""Data sets that may have opened their store."""


def _close_all() -> None:
    """Close the stores: a forked process cannot use an index of its parent, nor destroy it."""
    for each in list(_WITH_STORE):
        each.close()


# The garbage collector of the child leaves alone what the parent had not yet destroyed.
os.register_at_fork(before=_close_all, after_in_child=gc.freeze)


def _code(split: str) -> int:
    if split not in SPLITS[:3]:
        raise RequestError(f"split {split!r}: one of {', '.join(SPLITS[:3])}")
    return SPLITS.index(split)
