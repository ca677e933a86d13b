"""Metric `brightness`: an axis of the gap, how much brighter real images are."""

from __future__ import annotations

import numpy as np

from s2rstore import intervals
from s2rtools.gap import instance_selection
from s2rtools.gap.axes import AxisRecord
from s2rtools.gap.axis import Anchor, Axis, AxisResult, Evidence, GapSettings


class Brightness(Axis):
    """m = mean over pairs of the absolute difference of the mean grey values; 0 without a gap."""

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        store, run = evidence.store, evidence.store.run(evidence.run)
        iids = store.in_recording_order(evidence.iids)
        sim, real = (
            np.array([store.frame(domain, int(iid)).rgb.mean() for iid in iids])
            for domain in (run.sim_domain, run.real_domain)
        )
        values = np.abs(real - sim)
        codes = store.instances.trajectory[iids]
        return AxisResult(
            float(values.mean()), 0.0, iids.size,
            lambda level: intervals.mean(values, codes, level=level),
            {"poses": instance_selection.poses_sha256(store), "expression": evidence.expression},
        )  # fmt: skip

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        return Anchor(intervals.Interval.unknown(64.0, "by definition"), "64 grey levels")


RECORD = AxisRecord(
    "brightness", "grey levels", "difference of the mean grey values of both images",
    "0: both images are equally bright", "s2r_example_plugins.metric:Brightness",
)  # fmt: skip
