"""Load what was calibrated for the domains of a run."""

from __future__ import annotations

from s2rstore.reader import Store
from s2rstore.records import SIDES, Run
from s2rstore.run_inputs import run_domain
from s2rtools.heatmaps.harmonization import ImageAlignment
from s2rtools.precompute.depth_calibration import load_tolerance


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
