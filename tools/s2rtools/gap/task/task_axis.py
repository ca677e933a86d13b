"""The task axis: mean difference of a run's errors on real and on sim images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import InconclusiveError
from s2rstore.intervals import (
    LEVEL,
    MIN_DIFFERENCE,
    Interval,
    paired_difference,
    ratio_of_means,
)
from s2rstore.metrics import run_metrics
from s2rtools.common.command_line import output
from s2rtools.gap import instance_selection
from s2rtools.gap.axis import Anchor, Axis, AxisResult, Details, Evidence, GapSettings
from s2rtools.gap.task.rank_consistency import rank_consistency

Floats = NDArray[np.float64]

SECTORS = 8


@dataclass(frozen=True, slots=True, eq=False)
class GroupErrors:
    """Errors (n,) of the same instances in recording order, in metres, and their trajectories.

    `constant` is the error of the constant prediction of the mean position, on sim images.
    """

    sim: Floats
    real: Floats
    constant: Floats
    trajectory: NDArray[np.integer]

    @property
    def gap(self) -> Floats:
        return self.real - self.sim

    def of(self, rows: NDArray[np.bool_]) -> GroupErrors:
        """The errors of some rows (n,)."""
        return GroupErrors(
            self.sim[rows], self.real[rows], self.constant[rows], self.trajectory[rows]
        )

    def mean_gap(self, level: float = LEVEL) -> Interval:
        """The mean of real error - sim error."""
        return paired_difference(self.gap, self.trajectory, level=level)

    def relative_drop(self, level: float = LEVEL) -> Interval:
        """The mean gap as a share of the mean sim error; unknown where that is 0."""
        if not self.sim.mean() > 0:
            return Interval.unknown(reason="the sim error is 0")
        return ratio_of_means(self.real, self.sim, self.trajectory, level=level).scaled(1, -1)


def group_metrics(
    errors: GroupErrors, codes: NDArray[np.integer], names: Sequence[str], level: float
) -> dict[str, dict[str, Any]]:
    """Metrics by name of the group: n, mean errors, gap and relative drop with their intervals.

    `baseline` is the mean error of the constant prediction. `codes` (n,) index `names`; other codes
    belong to no group.
    """
    metrics = {}
    for code, name in enumerate(names):
        rows = codes == code
        if not rows.any():
            continue
        group = errors.of(rows)
        metrics[name] = {
            "n": int(group.sim.size),
            "sim": float(group.sim.mean()),
            "real": float(group.real.mean()),
            "baseline": float(group.constant.mean()),
            "gap": group.mean_gap(level).as_json(),
            "relative_drop": group.relative_drop(level).as_json(),
        }
    return metrics


class TaskAxis(Axis):
    """m = mean over the instances of real error - sim error.

    Both sides show the same poses, so the mean of the paired differences does not depend on how
    difficult the poses are, and without a gap it is 0. The anchor is an untrained model: the error
    of always predicting the mean position, minus the sim error.

    A reference applies to the same poses and selection, no matter how many of them a model was
    trained on: m and its floor do not depend on n, and the anchor is a frozen length in metres. On
    other instances the error of the constant prediction differs, within the interval of the anchor.
    A new anchor for every measurement would change G without a change of the gap.
    """

    def missing(self, evidence: Evidence) -> str | None:
        return instance_selection.uncomputed_reason(evidence)

    def measure(self, evidence: Evidence, settings: GapSettings) -> AxisResult:
        iids, errors = _errors(evidence)
        left_out = instance_selection.selected(evidence).size - iids.size
        notes: tuple[str, ...] = (instance_selection.sample_note(errors.mean_gap(settings.level)),)
        if left_out:
            notes += (f"{left_out} instances are left out: not predicted, or used for training",)
        return AxisResult(
            value=float(errors.gap.mean()),
            floor=0.0,
            n=iids.size,
            bounds=errors.mean_gap,
            fingerprint={
                "poses": instance_selection.poses_sha256(evidence.store),
                "expression": evidence.expression,
                "error": "distance to the ground truth, m",
            },
            details=_details(evidence, iids, errors, settings),
            notes=notes,
        )

    def anchor(self, evidence: Evidence, settings: GapSettings) -> Anchor:
        _, errors = _errors(evidence)
        gap = errors.constant - errors.sim
        interval = paired_difference(gap, errors.trajectory, level=settings.level)
        return Anchor(interval, "the constant prediction of the mean position")

    def compare_runs(self, evidence: Evidence, settings: GapSettings) -> dict[str, Any]:
        try:
            ranks = rank_consistency(evidence.store, evidence.iids, settings)
        except InconclusiveError as error:
            return {"refused": str(error)}
        return ranks.as_json()

    def describe(self, details: Details) -> Iterator[str]:
        drop = details["relative_drop"]
        yield (
            f"mean error {details['sim']:.2f} m in simulation, {details['real']:.2f} m in reality, "
            f"{details['baseline']:.2f} m for the constant prediction; relative drop "
            f"{Interval.from_json(drop).with_bounds()}"
        )
        for kind in ("runs", "trajectories", "rooms", "headings"):
            groups = details[kind].items()
            if len(groups) < 2:
                continue
            by_gap = sorted(groups, key=lambda item: -item[1]["gap"]["value"])
            rows = [
                (name, row["n"], row["sim"], row["real"], row["baseline"],
                 Interval.from_json(row["gap"]).with_bounds(),
                 Interval.from_json(row["relative_drop"]).with_bounds())
                for name, row in by_gap
            ]  # fmt: skip
            names = (kind, "n", "sim m", "real m", "constant m", "gap m", "relative drop")
            yield output.table(names, rows)


def _errors(evidence: Evidence) -> tuple[NDArray[np.int64], GroupErrors]:
    """Raises InconclusiveError where there are too few instances."""
    store, iids = evidence.store, instance_selection.held_out(evidence)
    columns = store.run_columns(evidence.run)
    instance_selection.require_instances(evidence, iids, MIN_DIFFERENCE)
    every = run_metrics.population(store, evidence.run)
    positions = store.poses(store.run(evidence.run).sim_domain)[:, :2]
    constant = np.hypot(*(positions[iids] - positions[every].mean(axis=0)).T)
    trajectory = store.instances.trajectory[iids]
    errors = GroupErrors(columns.sim.error[iids], columns.real.error[iids], constant, trajectory)
    return iids, errors


def _details(
    evidence: Evidence, iids: NDArray[np.int64], errors: GroupErrors, settings: GapSettings
) -> dict[str, Any]:
    truth = evidence.store.instances
    level = settings.level
    whole = group_metrics(errors, np.zeros(iids.size, np.int32), ["all"], level)["all"]
    sector, sector_names = heading_sectors(truth.heading[iids])
    return {
        **whole,
        "runs": _runs(evidence, level),
        "rooms": group_metrics(errors, truth.room[iids], truth.room_names, level),
        "headings": group_metrics(errors, sector, sector_names, level),
        "trajectories": group_metrics(
            errors, truth.trajectory[iids], truth.trajectory_names, level
        ),
    }


def heading_sectors(heading: Floats) -> tuple[NDArray[np.int64], list[str]]:
    """Sector codes (n,) of headings in rad, and the names of the sectors: centres in degrees."""
    width = 2 * np.pi / SECTORS
    code = np.floor(np.mod(heading + width / 2, 2 * np.pi) / width).astype(np.int64) % SECTORS
    degrees = np.mod(np.arange(SECTORS) * 360 // SECTORS + 180, 360) - 180
    return code, [str(int(centre)) for centre in degrees]


def _runs(evidence: Evidence, level: float) -> dict[str, Any]:
    """The same metrics for every computed run with enough instances of the selection."""
    metrics: dict[str, Any] = {}
    for run in evidence.store.runs.values():
        if run.key is None:
            continue
        try:
            iids, errors = _errors(replace(evidence, run=run.run))
        except InconclusiveError:
            continue
        metrics |= group_metrics(errors, np.zeros(iids.size, np.int32), [run.run], level)
    return metrics
