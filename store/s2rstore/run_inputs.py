"""The inputs of one side of a run: its cameras, and its frames before image adjustments.

A side with moved cameras has rendered frames, which are stored as arrays of the run.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.errors import RequestError
from s2rstore.geometry.camera_offset import UNMOVED, CameraMove, camera_move
from s2rstore.reader import Frame, Store
from s2rstore.records import Domain, Run, Side

FRAME_KINDS = {"rgb": "frames:rgb", "depth": "frames:depth"}
"""Kinds of the arrays that hold rendered frames."""


def run_camera_move(store: Store, run: Run, side: Side) -> CameraMove:
    """The camera offset of one side of a run."""
    domain = store.domain(run.domain(side))
    return camera_move(run.adjustments(side), domain, store.dataset.frame_width)


def run_domain(store: Store, run: Run, side: Side) -> Domain:
    """A side's domain with the cameras of the run's frames."""
    return run_camera_move(store, run, side).applied(store.domain(run.domain(side)))


def run_frame(store: Store, run: Run, side: Side, iid: int) -> Frame:
    """The frame of one instance on a side.

    Raises RequestError for an unknown instance, and where rendered frames are not computed yet.
    """
    if run_camera_move(store, run, side) == UNMOVED:
        return store.frame(iid, run.domain(side))
    if not 0 <= iid < len(store.instances):
        raise RequestError(f"instance {iid}: the store holds 0 .. {len(store.instances) - 1}")
    images = run_frames(store, run, side, iid, iid + 1)
    domain, depth = store.domain(run.domain(side)), images["depth"][0]
    valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    return Frame(images["rgb"][0], depth, valid)


def run_frames(
    store: Store,
    run: Run,
    side: Side,
    start: int,
    stop: int,
    images: tuple[str, ...] = ("rgb", "depth"),
) -> dict[str, NDArray[Any]]:
    """A side's images of iids [start, stop), in the form of `Store.frames`."""
    if run_camera_move(store, run, side) == UNMOVED:
        return store.frames(run.domain(side), start, stop, images)
    frames = {}
    for image in images:
        _, array = store.array(run.run, FRAME_KINDS[image], side)
        frames[image] = np.asarray(stored_array.read_rows(array, start, min(stop, array.shape[0])))
    return frames
