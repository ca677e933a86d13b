"""The group of instances with the largest real errors, compared with all other instances."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.findings.finding import (
    MIN_INSTANCES,
    Finding,
    bounds_text,
    evidence_text,
    sample_text,
)
from s2rstore.findings.groups import Group, Grouping, Groups, groups_of, members_of, real_median
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.intervals import Interval, difference_of, simultaneous_level
from s2rstore.reader import Store

_PLURALS: dict[Grouping, str] = {
    "room": "rooms",
    "heading": "heading sectors",
    "curvature": "curvatures",
    "trajectory": "trajectories",
}
Members = Mapping[int, NDArray[np.int64]]


def worst_group(
    store: Store, run: str, grouping: Grouping, population: NDArray[np.bool_]
) -> Finding | None:
    """The group with the largest median real error among `population` (N,) that is evident.

    A group is evident where its median exceeds that of all other instances, by an interval that
    holds for all groups at once. Where none is, the group with the largest median is returned.
    Groups with fewer than `MIN_INSTANCES` instances do not count. None where fewer than two count.
    """
    grouped, members = _counted_groups(store, grouping, population)
    if len(members) < 2:
        return None
    errors = store.run_columns(run).real.error
    medians = {code: float(np.median(errors[iids])) for code, iids in members.items()}
    ordered = sorted(members, key=lambda code: -medians[code])
    overall = float(np.median(errors[population]))
    tested = (
        (code, _difference(store, run, population, members, code))
        for code in ordered
        if medians[code] > overall
    )
    largest = ordered[0]
    evident = next((found for found in tested if found[1].is_positive), None)
    worst, difference = evident or (
        largest, _difference(store, run, population, members, largest),
    )  # fmt: skip
    note = ""
    if worst != largest:
        note = (
            f"; {grouped.groups[largest].name} is larger, {medians[largest]:.2f} m, but not "
            f"evident, n {members[largest].size}"
        )
    return _finding(
        store, run, grouping, grouped.groups[worst], members[worst], difference, len(members), note
    )


def largest_group(
    store: Store, run: str, grouping: Grouping, population: NDArray[np.bool_]
) -> tuple[Group, float, int] | None:
    """The group that `worst_group` tests first: group, median real error in metres, and n.

    It needs no intervals, which take some tenths of a second for a million instances.
    """
    grouped, members = _counted_groups(store, grouping, population)
    if len(members) < 2:
        return None
    errors = store.run_columns(run).real.error
    medians = {code: float(np.median(errors[iids])) for code, iids in members.items()}
    code = max(medians, key=lambda code: medians[code])
    return grouped.groups[code], medians[code], int(members[code].size)


def _counted_groups(
    store: Store, grouping: Grouping, population: NDArray[np.bool_]
) -> tuple[Groups, Members]:
    """All groups, and the members of those with enough instances."""
    grouped = groups_of(store, grouping)
    members = {
        code: iids
        for code, iids in members_of(store, grouped, population).items()
        if iids.size >= MIN_INSTANCES and grouped.groups[code].name != NO_ROOM
    }
    return grouped, members


def _difference(
    store: Store, run: str, population: NDArray[np.bool_], members: Members, code: int
) -> Interval:
    """The median of a group minus that of all other instances, for all groups at once."""
    errors, trajectory = store.run_columns(run).real.error, store.instances.trajectory
    others = population.copy()
    others[members[code]] = False
    level = simultaneous_level(len(members))
    inside, outside = (
        intervals.median(errors[rows], trajectory[rows], level=level)
        for rows in (members[code], store.in_recording_order(others))
    )
    return difference_of(inside, outside)


def _finding(
    store: Store,
    run: str,
    grouping: Grouping,
    group: Group,
    iids: NDArray[np.int64],
    difference: Interval,
    compared: int,
    note: str,
) -> Finding:
    columns = store.run_columns(run)
    median = real_median(store, run, iids, simultaneous_level(compared))
    evident = difference.is_positive
    text = (
        f"{group.name}: median real error {median.value:.2f} m ({bounds_text(median)}), "
        f"{sample_text(median, iids.size)} new"
    )
    apart = "" if math.isnan(difference.value) else f"{difference.value:+.2f} m from all others "
    return Finding(
        kind=f"worst {grouping}",
        text=text,
        run=run,
        n=int(iids.size),
        evidence=f"{apart}({evidence_text(difference, compared, _PLURALS[grouping])}){note}",
        evident=evident,
        values={
            grouping: group.name,
            "median_real_error_m": median.value,
            "median_real_error_low_m": median.low,
            "median_real_error_high_m": median.high,
            "median_sim_error_m": float(np.median(columns.sim.error[iids])),
            "median_gap_m": float(np.median(columns.gap[iids])),
            "difference_to_others_m": difference.value,
        },
        interval=difference,
        interval_of="difference_to_others_m",
        comparisons=compared,
        node=group.node,
        view="map" if grouping == "room" else "rooms",
        grouping=grouping,
    )
