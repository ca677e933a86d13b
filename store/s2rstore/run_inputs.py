"""The inputs of one side of a run: its cameras, and its frames before image adjustments.

A side with moved cameras has rendered frames, which are stored as arrays of the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.dataset_reader import Frame
from s2rstore.geometry.camera_offset import UNCHANGED, RenderChange, render_change
from s2rstore.reader import Store
from s2rstore.records import Domain, Run, Side

FRAME_KINDS = {"rgb": "frames:rgb", "depth": "frames:depth"}
"""Kinds of the arrays that hold rendered frames."""


def chain_text(chain: Sequence[Mapping[str, Any]]) -> str:
    """A chain as the command line takes it: `brightness=1.15, translate=T@0.5`."""
    return ", ".join(_step_text(str(step["name"]), float(step["value"])) for step in chain)


def _step_text(name: str, value: float) -> str:
    kind, colon, translator = name.partition(":")
    if not colon:
        return f"{name}={value:g}"
    return f"{kind}={translator}" if value == 1 else f"{kind}={translator}@{value:g}"


def run_render_change(store: Store, run: Run, side: Side) -> RenderChange:
    """What the adjustments of one side of a run change in rendering its domain."""
    domain = store.domain(run.domain(side))
    return render_change(run.adjustments(side), domain, store.dataset.frame_width)


def run_domain(store: Store, run: Run, side: Side) -> Domain:
    """A side's domain with the cameras of the run's frames."""
    return run_render_change(store, run, side).applied(store.domain(run.domain(side)))


def run_frame(store: Store, run: Run, side: Side, iid: int) -> Frame:
    """The frame of one instance on a side.

    Raises RequestError for an unknown instance, and where rendered frames are not computed yet.
    """
    store.check_instance(iid)
    images = run_frames(store, run, side, iid, iid + 1)
    return Frame.of(images["rgb"][0], images["depth"][0], store.domain(run.domain(side)))


def run_frames(
    store: Store,
    run: Run,
    side: Side,
    start: int,
    stop: int,
    images: tuple[str, ...] = ("rgb", "depth"),
) -> dict[str, NDArray[Any]]:
    """A side's images of iids [start, stop), in the form of `Store.frames`."""
    if run_render_change(store, run, side) == UNCHANGED:
        return store.frames(run.domain(side), start, stop, images)
    frames = {}
    for image in images:
        _, array = store.array(run.run, FRAME_KINDS[image], side)
        frames[image] = np.asarray(stored_array.read_rows(array, start, stop))
    return frames
