"""Estimate how far the depth of two domains differs by the sensor alone, once per pair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, fields

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.index.transaction import edit
from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rtools.counterfactual.depth_tolerance import (
    DepthPair,
    DepthTolerance,
    estimate_tolerance,
)
from s2rtools.counterfactual.pair_counterfactuals import scaled_cameras, working_size
from s2rtools.counterfactual.view_synthesis import DepthInRgbView, ViewSynthesis
from s2rtools.precompute.rig_calibration import comparable_iids, read_images

VERSION = 2


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
    if store.provenance(_section(run)).get("version") == str(VERSION):
        return False
    found = estimate_tolerance(_depth_pairs(store, run))
    with edit(store.path, check) as draft:
        draft.set_provenance(_section(run), {**asdict(found), "version": VERSION})
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
