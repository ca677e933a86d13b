"""The group of instances with the largest real errors, compared with all other instances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rstore.findings.expressions import exact
from s2rstore.findings.finding import MIN_INSTANCES, Finding, bounds_text, evidence_text
from s2rstore.findings.groups import Grouping, groups_of, members_of
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.metrics.bootstrap import (
    median_difference_interval,
    median_interval,
    simultaneous,
)
from s2rstore.reader import Store

_NAMES: dict[Grouping, tuple[str, str]] = {
    "room": ("room", "rooms"),
    "heading": ("heading sector", "heading sectors"),
    "curvature": ("curvature", "curvatures"),
    "trajectory": ("trajectory", "trajectories"),
}


def worst_group(
    store: Store, run: str, grouping: Grouping, population: NDArray[np.bool_]
) -> Finding | None:
    """The group with the largest median real error among `population` (N,).

    Groups with fewer than `MIN_INSTANCES` instances do not count. It is evident where the group's
    median exceeds that of all other instances, with an interval that holds in all groups at once,
    because the worst of them was picked. None where fewer than two groups count.
    """
    name, plural = _NAMES[grouping]
    grouped = groups_of(store, grouping)
    columns, trajectory = store.run_columns(run), store.instances.trajectory
    errors = columns.real.error
    members = {
        code: iids
        for code, iids in members_of(store, grouped, population).items()
        if iids.size >= MIN_INSTANCES and grouped.groups[code].name != NO_ROOM
    }
    if len(members) < 2:
        return None
    worst = max(members, key=lambda code: float(np.median(errors[members[code]])))
    inside, group = members[worst], grouped.groups[worst]
    is_inside = np.zeros(population.size, dtype=np.bool_)
    is_inside[inside] = True
    outside = store.in_recording_order(population & ~is_inside)
    median = median_interval(errors[inside], trajectory[inside])
    difference = median_difference_interval(
        (errors[inside], trajectory[inside]),
        (errors[outside], trajectory[outside]),
        simultaneous(len(members)),
    )
    evident = difference.low > 0
    figures = f"{median.value:.2f} m ({bounds_text(median)}), n {inside.size} new"
    subject = f"{group.name}: median real error {figures}"
    text = subject if evident else f"no {name} is evidently worse; largest: {subject}"
    return Finding(
        kind=f"worst {name}",
        text=text,
        run=run,
        n=int(inside.size),
        evidence=f"{difference.value:+.2f} m from all other instances "
        f"({evidence_text(difference, len(members), plural)})",
        evident=evident,
        values={
            grouping: group.name,
            "median_real_error_m": median.value,
            "median_real_error_low_m": median.low,
            "median_real_error_high_m": median.high,
            "median_sim_error_m": float(np.median(columns.sim.error[inside])),
            "median_gap_m": float(np.median(columns.gap[inside])),
            "difference_to_others_m": difference.value,
        },
        interval=difference,
        interval_of="difference_to_others_m",
        comparisons=len(members),
        node=exact(store, run, group.node, is_inside),
        view="rooms" if grouping != "room" else "map",
    )
