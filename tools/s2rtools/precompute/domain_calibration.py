"""What is estimated once per pair of domains: the real camera's deviation, and the noise of depth.

How far the real camera deviates from its declaration, and how far the depth of both domains differs
by the sensor alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, fields
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rstore.records import SIDES, Domain, Run
from s2rstore.run_inputs import run_domain
from s2rtools.common.blocks import evenly_spread
from s2rtools.counterfactual.depth_tolerance import (
    DepthPair,
    DepthTolerance,
    estimate_tolerance,
)
from s2rtools.counterfactual.pair_counterfactuals import scaled_cameras, working_size
from s2rtools.counterfactual.view_synthesis import DepthInRgbView, ViewSynthesis
from s2rtools.heatmaps.harmonization import CameraView, ImageAlignment, ViewImages

MAX_FRAMES = 24
MAX_SIDE = 128
MIN_OVERLAP = 0.1
MIN_GAIN = 0.02
"""Gain of correlation from which a correction is accepted."""
VERSION = 2
COARSE_HEIGHT = np.round(np.arange(-0.24, 0.241, 0.06), 3)
COARSE_ZOOM = np.round(np.arange(0.84, 1.161, 0.04), 3)
FINE_HEIGHT = (-0.04, -0.02, 0.0, 0.02, 0.04)
FINE_ZOOM = (-0.02, 0.0, 0.02)

_CalibrationPair = tuple[ViewImages, ViewImages, NDArray[np.float32]]
"""Sim and real images of an instance, and the gradients of the sim image."""


def ensure_calibrated(store: Store, run: Run, check: Callable[[], None] = lambda: None) -> bool:
    """Calibrate the run's pair of domains and publish the result; False if it exists.

    Uses image pairs spread over the data set, at most `MAX_SIDE` pixels on their longer side, whose
    images have one pose. Without such pairs there is no correction.
    `check` is called before it is published, see `edit`.
    """
    section = f"alignment:{run.sim_domain}|{run.real_domain}"
    if store.provenance(section).get("version") == str(VERSION):
        return False
    domains = [store.domain(run.domain(side)) for side in SIDES]
    size = store.dataset.frame_height, store.dataset.frame_width
    share = min(1.0, MAX_SIDE / max(size))
    frame = max(8, round(size[0] * share)), max(8, round(size[1] * share))
    iids = comparable_iids(store, run)
    sim_images, real_images = (
        [read_images(store, int(iid), domain, frame) for iid in iids] for domain in domains
    )
    pairs = list(zip(sim_images, real_images, strict=True))
    sim, real = (scaled_cameras(domain, size, frame) for domain in domains)
    offset = calibrate(sim, real, frame, pairs)
    with edit(store.path, check) as draft:
        facts = {
            "height": offset.height, "zoom": offset.zoom, "frames": len(pairs), "version": VERSION,
        }  # fmt: skip
        draft.set_provenance(section, facts)
    return True


def comparable_iids(store: Store, run: Run) -> NDArray[np.intp]:
    """At most `MAX_FRAMES` iids, evenly spread, of pairs whose images have nearly one pose."""
    imaged = store.imaged(run.sim_domain, run.real_domain)
    iids = np.flatnonzero(store.comparable_pairs & imaged)
    return iids[evenly_spread(iids.size, MAX_FRAMES)]


def read_images(store: Store, iid: int, domain: Domain, frame: tuple[int, int]) -> ViewImages:
    stored = store.frame(domain.domain, iid)
    size = frame[1], frame[0]
    rgb = cv2.resize(stored.rgb, size, interpolation=cv2.INTER_AREA)
    depth = cv2.resize(stored.depth, size, interpolation=cv2.INTER_NEAREST)
    return np.asarray(rgb), depth, (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)


def calibrate(
    sim: Domain,
    real: Domain,
    frame: tuple[int, int],
    image_pairs: list[tuple[ViewImages, ViewImages]],
) -> RigOffset:
    """Find the height and focal length of the real camera that align the image gradients best.

    The search covers 24 cm up and down and 16 % of the focal length, coarsely on a few pairs, then
    in steps of 2 cm and 2 % on all; pitch stays as declared. The score is the mean correlation of
    gradient magnitudes between the sim and the warped real image. No correction is returned
    unless it gains at least `MIN_GAIN`.
    """
    prepared = [(sim_images, real_images, _gradient(sim_images[0]))
                for sim_images, real_images in image_pairs]  # fmt: skip

    def score(correction: RigOffset, pairs: list[_CalibrationPair]) -> float:
        return _mean_correlation(ImageAlignment(sim, real, frame, correction).sim_view, pairs)

    subset = prepared[:: max(1, len(prepared) // 10)]
    coarse = [RigOffset(float(h), float(z)) for h in COARSE_HEIGHT for z in COARSE_ZOOM]
    around = max(coarse, key=lambda correction: score(correction, subset))
    fine = [
        RigOffset(round(around.height + h, 3), round(around.zoom + z, 3))
        for h in FINE_HEIGHT
        for z in FINE_ZOOM
    ]
    best, chosen = score(RigOffset(), prepared), RigOffset()
    for correction in fine:
        value = score(correction, prepared)
        if value > best + (MIN_GAIN if chosen == RigOffset() else 1e-9):
            best, chosen = value, correction
    return chosen


def _mean_correlation(view: CameraView, pairs: list[_CalibrationPair]) -> float:
    """Mean correlation of gradients; a pair that hardly overlaps counts as 0."""
    scores = []
    for sim, real, gradient in pairs:
        rgb, visible = view.warp_colours(sim, real, view.metres(*sim[1:]))
        inner = cv2.erode(visible.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        correlation = 0.0
        if inner.mean() > MIN_OVERLAP:
            with np.errstate(invalid="ignore", divide="ignore"):
                correlation = float(np.corrcoef(gradient[inner], _gradient(rgb)[inner])[0, 1])
        scores.append(correlation if np.isfinite(correlation) else 0.0)
    return float(np.mean(scores)) if scores else 0.0


def _gradient(image: NDArray[Any]) -> NDArray[np.float32]:
    grey = cv2.cvtColor(image.astype(np.float32), cv2.COLOR_RGB2GRAY)
    grey = cv2.GaussianBlur(grey, (0, 0), 1.0)
    return np.asarray(
        np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    )


TOLERANCE_VERSION = 2


def load_tolerance(store: Store, run: Run) -> DepthTolerance | None:
    """The stored tolerance of the run's domains; None where it was not estimated.

    Raises RequestError if it is invalid.
    """
    noted = store.provenance(_section(run))
    if not noted:
        return None
    try:
        found = DepthTolerance(**{f.name: float(noted[f.name]) for f in fields(DepthTolerance)})
        is_valid = 0 < found.base < 10 and 0 <= found.slope < 10 and 0 <= found.near < found.far
        if not (is_valid and abs(found.shift) < 10 and 0.1 < found.scale < 10):
            raise ValueError("out of range")
        return found
    except (KeyError, ValueError) as error:
        what = f"the depth tolerance of {run.sim_domain} and {run.real_domain}"
        raise RequestError(
            f"{store.path}: {what} is invalid; run `s2r precompute` again"
        ) from error


def ensure_depth_tolerance(
    store: Store, run: Run, check: Callable[[], None] = lambda: None
) -> bool:
    """Estimate the tolerance of the run's pair of domains and publish it; False if it exists.

    The rigs must be calibrated. Uses the same image pairs as their calibration. `check` is called
    before it is published, see `edit`.
    """
    if store.provenance(_section(run)).get("version") == str(TOLERANCE_VERSION):
        return False
    found = estimate_tolerance(_depth_pairs(store, run))
    with edit(store.path, check) as draft:
        draft.set_provenance(_section(run), {**asdict(found), "version": TOLERANCE_VERSION})
    return True


def _section(run: Run) -> str:
    return f"depth_tolerance:{run.sim_domain}|{run.real_domain}"


def _depth_pairs(store: Store, run: Run) -> list[DepthPair]:
    """Real depth and that of the sim surface in the real view, of some instances."""
    frame = store.dataset.frame_height, store.dataset.frame_width
    size = working_size(frame)
    offset = store.rig_offset(run.sim_domain, run.real_domain)
    declared = {side: store.domain(run.domain(side)) for side in SIDES}
    calibrated = {"sim": declared["sim"], "real": declared["real"]}
    if offset is not None:
        calibrated["real"] = offset.applied(declared["real"])
    rigs = {side: scaled_cameras(calibrated[side], frame, size) for side in SIDES}
    synthesis = ViewSynthesis(rigs["sim"], rigs["real"], size)
    registrations = {side: DepthInRgbView(rigs[side], size) for side in SIDES}
    pairs = []
    for iid in comparable_iids(store, run):
        rgb, *depth = read_images(store, int(iid), declared["sim"], size)
        made = synthesis(rgb, registrations["sim"].metres(*depth))
        _, *depth = read_images(store, int(iid), declared["real"], size)
        real = registrations["real"].metres(*depth)
        pairs.append((real, np.where(made.seen, made.depth, np.float32(0))))
    return pairs


def load_alignment(store: Store, run: Run) -> ImageAlignment | None:
    """The rigs of a run with the stored correction; None if the domains are not calibrated.

    The correction applies to the declared cameras, so it also holds if the run moves a camera.
    """
    correction = store.rig_offset(run.sim_domain, run.real_domain)
    if correction is None:
        return None
    frame = store.dataset.frame_height, store.dataset.frame_width
    sim, real = (run_domain(store, run, side) for side in SIDES)
    return ImageAlignment(sim, real, frame, correction, load_tolerance(store, run))
