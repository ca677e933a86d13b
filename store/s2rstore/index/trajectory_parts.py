"""Which instances of a trajectory belong to which part of a store, and so to which frame arrays.

The instances of a trajectory follow one another within a part. Those that were appended to a
trajectory belong to a later part, and their frames lie in arrays of their own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.records import Trajectory, TrajectoryPart

Query = Callable[[str], Sequence[tuple[Any, ...]]]

_GROUPS = """
    SELECT trajectory, {part}, min(iid), count(*) FROM instance {join}
    GROUP BY ALL ORDER BY min(iid)
"""
_ONE_PART = _GROUPS.format(part="0", join="")
_PARTS = _GROUPS.format(part="part", join="ASOF JOIN part ON instance.iid >= part.first_iid")


def trajectory_parts(execute: Query) -> list[TrajectoryPart]:
    """The parts of all trajectories of an index, in order of their first instances.

    `execute` gives the rows of a query on the index.
    """
    has_parts = bool(execute("SELECT 1 FROM part LIMIT 1"))
    rows: Counter[str] = Counter()
    parts = []
    for trajectory, part, first_iid, count in execute(_PARTS if has_parts else _ONE_PART):
        parts.append(TrajectoryPart(trajectory, part, first_iid, count, rows[trajectory]))
        rows[trajectory] += count
    return parts


def check_contiguous(
    parts: Sequence[TrajectoryPart], trajectories: Sequence[Trajectory], path: Path
) -> None:
    """Raise RequestError unless the parts follow one another and hold all stated instances."""
    counts: Counter[str] = Counter()
    stop = 0
    for part in parts:
        if part.first_iid != stop:
            break
        stop = part.stop
        counts[part.trajectory] += part.instances
    if counts != Counter({each.trajectory: each.instances for each in trajectories}):
        raise RequestError(
            f"{path}: the instances of a trajectory do not follow one another in the index; run "
            "`s2r verify`"
        )
