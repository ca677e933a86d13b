"""The task axis: how much larger a run's errors are on real images than on sim images."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError
from s2rstore.metrics import run_metrics
from s2rtools.gap import blocks, instance_selection
from s2rtools.gap.axis_result import Anchor, Axis, AxisResult, Evidence, GapSettings
from s2rtools.gap.task.group_metrics import (
    GroupErrors,
    grouped,
    mean_replicates,
    swap_interval,
)

Floats = NDArray[np.float64]

LEAST_INSTANCES = 20
LEAST_BLOCKS = 4
SECTORS = 8


class TaskAxis(Axis):
    """m = mean over the instances of real error - sim error.

    A reference fits the same poses and selection, however many of them a model was trained on: m
    and its floor do not depend on n, and the anchor stays the frozen one, which is a length in
    metres. On other instances of the data set the constant prediction would be off by another
    length, and G differ by their ratio; the anchor's interval, which the report shows, says by how
    much. Renewed anchors would let G move where the gap does not.
    """

    name: ClassVar[str] = "task"
    unit: ClassVar[str] = "m"
    measure_is: ClassVar[str] = "mean paired gap: real error - sim error"
    floor_is: ClassVar[str] = "0: without a gap the pairs differ by nothing"
    reason: ClassVar[str] = (
        "Both sides see the same poses, so the mean of the paired differences is free of how hard "
        "the poses are, and without a gap it is 0. The anchor is a model that has learnt nothing: "
        "the error of always predicting the mean position, less the sim error."
    )

    def missing(self, evidence: Evidence) -> str | None:
        return instance_selection.uncomputed(evidence)

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        iids, errors = _errors(evidence)
        left_out = instance_selection.selected(evidence).size - iids.size
        notes: tuple[str, ...] = (errors.blocks.told,)
        if left_out:
            notes += (f"{left_out} instances not predicted or trained on are left out",)
        return AxisResult(
            axis=self.name,
            value=float(errors.gap.mean()),
            floor=0.0,
            n=iids.size,
            replicates=mean_replicates(errors.gap, errors.blocks, settings),
            floor_replicates=np.zeros(settings.replicates),
            fingerprint={
                "poses": instance_selection.poses(evidence.store),
                "expression": evidence.expression,
                "error": "distance to the ground truth, m",
            },
            details=_details(evidence, iids, errors, settings),
            notes=notes,
        )

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        _, errors = _errors(evidence)
        worse = errors.constant - errors.sim
        return Anchor(
            value=float(worse.mean()),
            replicates=mean_replicates(worse, errors.blocks, settings),
            state="the constant prediction of the mean position",
        )


def _errors(evidence: Evidence) -> tuple[NDArray[np.int64], GroupErrors]:
    """Raises InconclusiveError where there are too few instances or blocks."""
    store, iids = evidence.store, instance_selection.held_out(evidence)
    truth, columns = store.instances, store.run_columns(evidence.run)
    cut = blocks.cut(truth.trajectory[iids])
    if iids.size < LEAST_INSTANCES or cut.count < LEAST_BLOCKS:
        raise InconclusiveError(
            f"{iids.size} usable instances of {evidence.expression!r} in {cut.count} "
            f"blocks; at least {LEAST_INSTANCES} in {LEAST_BLOCKS} are needed"
        )
    every = run_metrics.held_out(store, evidence.run)
    constant = np.hypot(
        truth.x[iids] - truth.x[every].mean(), truth.y[iids] - truth.y[every].mean()
    )
    return iids, GroupErrors(columns.sim.error[iids], columns.real.error[iids], constant, cut)


def _details(
    evidence: Evidence, iids: NDArray[np.int64], errors: GroupErrors, settings: GapSettings
) -> dict[str, Any]:
    truth = evidence.store.instances
    whole = grouped(errors, np.zeros(iids.size, np.int32), ["all"], settings)["all"]
    apart = replace(errors, blocks=errors.blocks.apart())
    sector, sector_names = heading_sectors(truth.heading[iids])
    return {
        **whole,
        "blocks": errors.blocks.count,
        "no_gap_interval": swap_interval(errors, settings),
        "runs": _runs(evidence, settings),
        "rooms": grouped(errors, truth.room[iids], truth.room_names, settings),
        "headings": grouped(errors, sector, sector_names, settings),
        "trajectories": grouped(apart, truth.trajectory[iids], truth.trajectory_names, settings),
    }


def heading_sectors(heading: Floats) -> tuple[NDArray[np.int64], list[str]]:
    """Sector codes (n,) of headings in rad, and the sectors' centres in degrees as names."""
    width = 2 * np.pi / SECTORS
    code = np.floor(np.mod(heading + width / 2, 2 * np.pi) / width).astype(np.int64) % SECTORS
    degrees = np.mod(np.arange(SECTORS) * 360 // SECTORS + 180, 360) - 180
    return code, [str(int(centre)) for centre in degrees]


def _runs(evidence: Evidence, settings: GapSettings) -> dict[str, Any]:
    """The same figures of every computed run with enough instances of the selection."""
    found: dict[str, Any] = {}
    for run in evidence.store.runs.values():
        if run.key is None:
            continue
        try:
            iids, errors = _errors(replace(evidence, run=run.run))
        except InconclusiveError:
            continue
        found |= grouped(errors, np.zeros(iids.size, np.int32), [run.run], settings)
    return found
