"""The images of one instance as a run's model received them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.dataset_reader import Frame
from s2rstore.errors import RequestError
from s2rstore.geometry.camera_offset import NAMES
from s2rstore.reader import Store
from s2rstore.records import Domain, Run, Side
from s2rstore.run_inputs import chain_text, run_frame

Chain = Sequence[Mapping[str, Any]]
_SHORT = 18


@dataclass(frozen=True, slots=True, eq=False)
class ModelInput:
    """rgb (H, W, 3) uint8, depth (H, W) metres with NaN where invalid, and their adjustments.

    Without an image, rgb has shape (0, 0, 3). Without depth, depth is None.
    `title` names a domain other than the side's usual one and short adjustments; `notes` hold
    adjustments that are too long for it. `original` is the RGB image before the adjustments, None
    where no translator is among them.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.float32] | None
    title: str
    notes: tuple[tuple[str, str], ...] = ()
    original: NDArray[np.uint8] | None = None


def model_input(
    store: Store, run: Run, side: Side, iid: int, at_source: bool = False
) -> ModelInput:
    """A side's frame after the run's adjustments; image adjustments need `s2rtools`.

    at_source: whether rgb has the size of its source, where that is stored and nothing adjusts it.
    """
    name, chain = run.domain(side), run.adjustments(side)
    has_frames = bool(name) and store.has_frames(name)
    if not has_frames or not store.is_imaged(name, iid):
        where = "image of this instance" if has_frames else "images in this store"
        missing = ((f"{side} frames", f"no {name or side} {where}"),)
        return ModelInput(np.zeros((0, 0, 3), dtype=np.uint8), None, "", missing)
    domain = store.domain(name)
    frame = run_frame(store, run, side, iid)
    images = [step for step in chain if step["name"] not in NAMES]
    adjusted = _adjusted(frame, domain, images, store.path) if images else frame
    shown = adjusted or frame
    depth = None
    if domain.has_depth:
        metres = np.where(shown.valid, shown.depth * np.float32(domain.depth_scale), np.nan)
        depth = metres.astype(np.float32)
    usual = "" if domain.domain == side and not chain else domain.domain
    title, notes = _title_and_notes(usual, side, chain, "" if adjusted else "before ")
    is_translated = adjusted is not None and any("sha256" in step for step in images)
    original = frame.rgb if is_translated else None
    rgb = source_rgb(store, name, iid) if at_source and not chain else shown.rgb
    return ModelInput(rgb, depth, title, notes, original)


def source_rgb(store: Store, domain: str, iid: int) -> NDArray[np.uint8]:
    """The image (H, W, 3) of an instance at the size of its source, or else of the frames."""
    _, images = next(store.source_frames(domain, iid, iid + 1, ("rgb",)))
    return np.asarray(images["rgb"][0])


def frame_rgb(store: Store, domain: str, iid: int) -> NDArray[np.uint8]:
    """The image (H, W, 3) of an instance at the size of the frames."""
    return np.asarray(store.frames(domain, iid, iid + 1, ("rgb",))["rgb"][0])


def stored_image(store: Store, side: Side, iid: int, at_source: bool = False) -> ModelInput:
    """An instance's image in the first domain of a kind that has one; for data sets without poses.

    The title names domains other than the side's own. rgb has shape (0, 0, 3) without an image.
    """
    of_kind = (name for name, domain in store.domains.items() if domain.kind == side)
    imaged = [name for name in of_kind if store.is_imaged(name, iid)]
    if not imaged:
        return ModelInput(np.zeros((0, 0, 3), dtype=np.uint8), None, "")
    read = source_rgb if at_source else frame_rgb
    rgb = read(store, imaged[0], iid)
    more = ((f"{side} domains", ", ".join(imaged)),) if len(imaged) > 1 else ()
    return ModelInput(rgb, None, "" if imaged[0] == side else imaged[0], more)


def _title_and_notes(
    domain: str, side: Side, chain: Chain, before: str
) -> tuple[str, tuple[tuple[str, str], ...]]:
    """The title and, if it would be too long, notes on camera and image adjustments."""
    text = chain_text(chain)
    if not chain or len(text) <= _SHORT:
        return ", ".join(part for part in (domain, before + text) if part), ()
    moving = [step for step in chain if step["name"] in NAMES]
    images = [step for step in chain if step["name"] not in NAMES]
    camera = chain_text(moving).replace("camera_", "")
    notes = [(f"{side} camera", camera)] if moving else []
    notes += [(f"{side} images", chain_text(images))] if images else []
    return f"{domain}, {before}adjust{'ments' if before else 'ed'}", tuple(notes)


def _adjusted(frame: Frame, domain: Domain, chain: Chain, store_path: Path) -> Frame | None:
    """The frame after its image adjustments; None if the tools are not installed."""
    try:
        from s2rtools.adjustments import apply_chain

        rgb, depth = apply_chain(
            frame.rgb[None], frame.depth[None], frame.valid[None], chain, store_path
        )
    except (ImportError, RequestError):
        return None
    inside = (depth[0] >= domain.depth_raw_min) & (depth[0] <= domain.depth_raw_max)
    return Frame(rgb[0], depth[0], inside)
