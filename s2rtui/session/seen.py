"""What a run's model was shown of one instance, as far as this machine can tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.move import NAMES
from s2rstore.reader import Frame, Store
from s2rstore.records import Domain, Run, Side
from s2rstore.sides import run_frame


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """rgb (H, W, 3) uint8, depth (H, W) metres with NaN where invalid, and what was done to them.

    `title` names the domain where it is not the side's usual one, and the adjustments; those that
    could not be shown after the word "before".
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32]
    title: str


def seen(store: Store, run: Run, side: Side, iid: int) -> Seen:
    """A side's frame through the run's adjustments; without `s2rtools` before those of images."""
    domain, chain = store.domain(run.domain(side)), run.adjustments(side)
    frame = run_frame(store, run, side, iid)
    moving = [step for step in chain if step["name"] in NAMES]
    images = [step for step in chain if step["name"] not in NAMES]
    adjusted = _adjusted(frame, domain, images) if images else frame
    told = [chain_text(moving)] if moving else []
    if images:
        told.append(f"{'' if adjusted else 'before '}{chain_text(images)}")
    shown = adjusted or frame
    metres = np.where(shown.valid, shown.depth * np.float32(domain.depth_scale), np.nan)
    title = ", ".join([domain.domain, *told]) if told or domain.domain != side else ""
    return Seen(shown.rgb, metres.astype(np.float32), title)


def chain_text(chain: Sequence[Mapping[str, Any]]) -> str:
    """`brightness=1.15, contrast=1.1`."""
    return ", ".join(f"{step['name']}={step['value']:g}" for step in chain)


def _adjusted(frame: Frame, domain: Domain, chain: Sequence[Mapping[str, Any]]) -> Frame | None:
    """The frame after its image adjustments; None where no tools are installed that know them."""
    try:
        from s2rtools.adjust import apply_chain

        rgb, depth = apply_chain(frame.rgb[None], frame.depth[None], frame.valid[None], chain)
    except (ModuleNotFoundError, RequestError):
        return None
    inside = (depth[0] >= domain.depth_raw_min) & (depth[0] <= domain.depth_raw_max)
    return Frame(rgb[0], depth[0], frame.valid & inside)
