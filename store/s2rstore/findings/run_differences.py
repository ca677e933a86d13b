"""The best run, and the largest regression between two runs, on instances new to both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.findings.expressions import new_to
from s2rstore.findings.finding import (
    MIN_INSTANCES,
    Finding,
    bounds_text,
    evidence_text,
    sample_text,
)
from s2rstore.findings.groups import Group, groups_of, members_of
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.intervals import Interval, simultaneous_level
from s2rstore.language import Node
from s2rstore.language.syntax_tree import Everything
from s2rstore.metrics import run_metrics
from s2rstore.reader import Store

MOST_RUNS = 12
"""Runs that are compared: the present one, and the first others of the store."""
Errors = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class RunErrors:
    """Real errors (N,) in metres of one run, and the (N,) mask of the instances new to it.

    knows_training: whether the store knows which instances its model was trained on.
    """

    run: str
    real: Errors
    new: Mask
    knows_training: bool = True


def read_runs(store: Store, run: str) -> list[RunErrors]:
    """The errors of `run` first, then those of other computed runs, at most `MOST_RUNS`."""
    computed = [name for name, record in store.runs.items() if record.key and name != run]
    found = []
    for name in [run, *computed][:MOST_RUNS]:
        new = run_metrics.population(store, name)
        knows = run_metrics.knows_training_set(store, name)
        found.append(RunErrors(name, store.run_columns(name).real.error, new, knows))
        if name != run:
            store.drop_run_columns(name)
    return found


def best_run(store: Store, runs: list[RunErrors]) -> Finding | None:
    """The run with the smallest mean real error, compared with every other one.

    It is evident where its mean is below that of each other run, by intervals that hold for all of
    these comparisons at once. Runs are compared on the instances that are new to all of them. Runs
    with fewer than `MIN_INSTANCES` new instances are left out. None where fewer than two runs can
    be compared.
    """
    present = runs[0].run
    compared = [run for run in runs if np.count_nonzero(run.new) >= MIN_INSTANCES]
    left_out = [run.run for run in runs if run not in compared]
    if len(compared) < 2:
        return None
    common = np.logical_and.reduce([run.new for run in compared])
    rows = store.in_recording_order(common)
    if rows.size < MIN_INSTANCES:
        return None
    trajectory = store.instances.trajectory[rows]
    ordered = sorted(compared, key=lambda run: float(run.real[rows].mean()))
    best, next_run = ordered[:2]
    level = simultaneous_level(len(compared))  # the best one is chosen by its mean
    mean = intervals.mean(best.real[rows], trajectory, level=level)
    comparisons = len(compared) - 1
    level = simultaneous_level(comparisons)
    differences = {
        run.run: intervals.paired_difference(
            run.real[rows] - best.real[rows], trajectory, level=level
        )
        for run in ordered[1:]
    }
    difference = differences[next_run.run]
    open_runs = [name for name, interval in differences.items() if not interval.is_positive]
    evident = not open_runs
    known = all(run.knows_training for run in compared)
    sample = (
        f"{sample_text(mean, rows.size)}, {'new to all' if known else 'not known to be trained on'}"
    )
    bounds = bounds_text(mean)
    if mean.is_known:
        bounds += f", corrected for {len(compared)} runs"
    figures = f"mean real error {mean.value:.2f} m ({bounds}), {sample}"
    text = f"{best.run}: {figures}"
    evidence = (
        f"next is {next_run.run}, {difference.value:+.2f} m "
        f"({evidence_text(difference, comparisons, 'comparisons')})"
    )
    if evident and comparisons > 1:
        evidence += "; evident against each of them"
    elif open_runs and difference.is_positive:
        evidence += f"; not evident against {', '.join(open_runs)}"
    if left_out:
        evidence += f"; without {', '.join(left_out)} (fewer than {MIN_INSTANCES} new instances)"
    others = {run.run: run.new for run in compared if run is not best}
    return Finding(
        kind="best run",
        text=text,
        run=best.run,
        n=int(rows.size),
        evidence=evidence,
        evident=evident,
        values={
            "best_run": best.run,
            "mean_real_error_m": mean.value,
            "mean_real_error_low_m": mean.low,
            "mean_real_error_high_m": mean.high,
            "next_run": next_run.run,
            "difference_to_next_m": difference.value,
        },
        interval=difference,
        interval_of="difference_to_next_m",
        comparisons=comparisons,
        node=new_to(Everything(), best.new, others),
        view="compare" if best.run == present else "overview",
        other=next_run.run,
    )


def largest_regression(store: Store, runs: list[RunErrors]) -> Finding | None:
    """The room and the other run where the first of `runs` is worse by the most that is evident.

    Compared are mean real errors per room (and over all instances) on instances new to both runs.
    None where there is nothing to compare.
    """
    present, *others = runs
    grouped = groups_of(store, "room")
    candidates: list[tuple[float, RunErrors, int | None, NDArray[np.int64]]] = []
    for other in others:
        common = present.new & other.new
        everywhere = (None, store.in_recording_order(common))
        for code, rows in (everywhere, *members_of(store, grouped, common).items()):
            is_room = code is None or grouped.groups[code].name != NO_ROOM
            if is_room and rows.size >= MIN_INSTANCES:
                mean = float((present.real[rows] - other.real[rows]).mean())
                candidates.append((mean, other, code, rows))
    if not candidates:
        return None
    level, trajectory = simultaneous_level(len(candidates)), store.instances.trajectory

    def increase_of(other: RunErrors, rows: NDArray[np.int64]) -> Interval:
        return intervals.paired_difference(
            present.real[rows] - other.real[rows], trajectory[rows], level=level
        )

    candidates.sort(key=lambda candidate: -candidate[0])
    tested = (
        (other, code, rows, increase_of(other, rows))
        for mean, other, code, rows in candidates
        if mean > 0
    )
    _, other, code, rows = candidates[0]
    evident_one = next((found for found in tested if found[3].is_positive), None)
    other, code, rows, increase = evident_one or (other, code, rows, increase_of(other, rows))
    room, where = ("all rooms", Everything()) if code is None else _room(grouped.groups[code])
    evident = increase.is_positive
    subject = room if increase.value > 0 else f"none, nearest is {room}"
    text = (
        f"{subject}: {increase.value:+.2f} m mean real error ({bounds_text(increase)}) from "
        f"{other.run} to {present.run}, n {rows.size} new to both"
    )
    return Finding(
        kind="largest regression",
        text=text,
        run=present.run,
        n=int(rows.size),
        evidence=f"the largest of {len(candidates)} increases, by room and run, corrected for "
        "their number",
        evident=evident,
        values={
            "room": room,
            "other_run": other.run,
            "mean_real_error_m": float(present.real[rows].mean()),
            "other_mean_real_error_m": float(other.real[rows].mean()),
            "increase_m": increase.value,
        },
        interval=increase,
        interval_of="increase_m",
        comparisons=len(candidates),
        node=new_to(where, present.new, {other.run: other.new}),
        view="compare",
        other=other.run,
    )


def _room(group: Group) -> tuple[str, Node]:
    return group.name, group.node
