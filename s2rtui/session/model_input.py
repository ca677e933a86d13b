"""What a run's model was shown of one instance, as far as this machine can tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.layout import FRAMES
from s2rstore.geometry.camera_offset import NAMES
from s2rstore.reader import Frame, Store
from s2rstore.records import Domain, Run, Side
from s2rstore.run_inputs import run_frame

Chain = Sequence[Mapping[str, Any]]
_SHORT = 18


@dataclass(frozen=True, slots=True, eq=False)
class ModelInput:
    """rgb (H, W, 3) uint8, depth (H, W) metres with NaN where invalid, and what was done to them.

    A store without frames gives rgb of shape (0, 0, 3) and no depth.
    `title` names the domain where it is not the side's usual one, and whether images are adjusted;
    `notes` tell the adjustments that are too long for it.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32] | None
    title: str
    notes: tuple[tuple[str, str], ...] = ()


def seen(store: Store, run: Run, side: Side, iid: int) -> ModelInput:
    """A side's frame through the run's adjustments; without `s2rtools` before those of images."""
    domain, chain = store.domain(run.domain(side)), run.adjustments(side)
    if not (store.path / FRAMES / domain.domain).is_dir():
        told = ((f"{side} frames", f"none of {domain.domain} in this store"),)
        return ModelInput(np.zeros((0, 0, 3), dtype=np.uint8), None, "", told)
    frame = run_frame(store, run, side, iid)
    images = [step for step in chain if step["name"] not in NAMES]
    adjusted = _adjusted(frame, domain, images) if images else frame
    shown = adjusted or frame
    metres = np.where(shown.valid, shown.depth * np.float32(domain.depth_scale), np.nan)
    usual = "" if domain.domain == side and not chain else domain.domain
    title, notes = _told(usual, side, chain, "" if adjusted else "before ")
    return ModelInput(shown.rgb, metres.astype(np.float32), title, notes)


def _told(
    domain: str, side: Side, chain: Chain, before: str
) -> tuple[str, tuple[tuple[str, str], ...]]:
    """The title and, where that would be long, a note on the camera and one on the images."""
    text = chain_text(chain)
    if not chain or len(text) <= _SHORT:
        return ", ".join(part for part in (domain, before + text) if part), ()
    moving = [step for step in chain if step["name"] in NAMES]
    images = [step for step in chain if step["name"] not in NAMES]
    camera = chain_text(moving).replace("camera_", "")
    notes = [(f"{side} camera", camera)] if moving else []
    notes += [(f"{side} images", chain_text(images))] if images else []
    return f"{domain}, {before}adjust{'ments' if before else 'ed'}", tuple(notes)


def chain_text(chain: Chain) -> str:
    """`brightness=1.15, contrast=1.1`."""
    return ", ".join(f"{step['name']}={step['value']:g}" for step in chain)


def _adjusted(frame: Frame, domain: Domain, chain: Chain) -> Frame | None:
    """The frame after its image adjustments; None where no tools are installed that know them."""
    try:
        from s2rtools.adjustments import apply_chain

        rgb, depth = apply_chain(frame.rgb[None], frame.depth[None], frame.valid[None], chain)
    except (ImportError, RequestError):
        return None
    inside = (depth[0] >= domain.depth_raw_min) & (depth[0] <= domain.depth_raw_max)
    return Frame(rgb[0], depth[0], frame.valid & inside)
