"""Groups of instances by room, heading, curvature or trajectory, and their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, cast, get_args

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.errors import RequestError
from s2rstore.findings.expressions import any_of
from s2rstore.geometry.curvature import STRAIGHT_BELOW
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.intervals import LEVEL, Interval
from s2rstore.language import Node, to_text
from s2rstore.language.syntax_tree import And, Bend, Compare, Everything, Field, Minus, Named, Or
from s2rstore.metrics.recall import headline_index, severities
from s2rstore.reader import Store

Grouping = Literal["room", "heading", "curvature", "trajectory"]
GROUPINGS: tuple[Grouping, ...] = get_args(Grouping)
SECTORS = 8
"""Number of heading sectors; the first is centred at heading 0."""
Codes = NDArray[np.integer[Any]]


@dataclass(frozen=True, slots=True)
class Group:
    """A group of instances by their true pose; `node` selects those of the population.

    `parts` are the names of the groups that it is the intersection of, if any.
    """

    name: str
    node: Node
    parts: tuple[str, ...] = ()

    @property
    def expression(self) -> str:
        """The text of the expression."""
        return to_text(self.node)


@dataclass(frozen=True, slots=True, eq=False)
class Groups:
    """Disjoint groups: `codes` (N,) index `groups`; -1 stands for none of them."""

    groups: tuple[Group, ...]
    codes: Codes


@dataclass(frozen=True, slots=True)
class GroupErrors:
    """Errors of a group's n instances in metres.

    real: median real error with its 95 % interval, for this group alone, NaN bounds where there
    are too few instances. sim, gap: median sim error, median of real error minus sim error.
    recall: share of the instances within the thresholds of the headline in reality. share: of the
    sum of the real errors of all groups.
    """

    group: Group
    n: int
    real: Interval
    sim: float
    gap: float
    recall: float = math.nan
    share: float = math.nan


def crossed(first: str, second: str) -> str:
    """The grouping by two: `room,heading`."""
    return f"{first},{second}"


def parts_of(grouping: str) -> tuple[Grouping, ...]:
    """The one or two groupings of `heading` or `room,heading`. Raises RequestError for others."""
    parts = tuple(part.strip() for part in grouping.split(","))
    known = [part for part in GROUPINGS if part in parts]
    if len(parts) > 2 or len(set(parts)) < len(parts) or len(known) < len(parts):
        allowed = ", ".join(GROUPINGS)
        raise RequestError(f"{grouping!r}: expected one or two different ones of {allowed}")
    return cast(tuple[Grouping, ...], parts)


def groups_of(store: Store, grouping: str) -> Groups:
    """All groups of a grouping, with the group of each instance.

    Those of two groupings are the pairs that occur. Raises RequestError as `parts_of` does.
    """
    parts = [_single(store, part) for part in parts_of(grouping)]
    if len(parts) == 1:
        return parts[0]
    first, second = parts
    known = (first.codes >= 0) & (second.codes >= 0)
    pairs = first.codes * len(second.groups) + second.codes
    present, codes = np.unique(pairs[known], return_inverse=True)
    every = np.full(known.shape, -1, dtype=np.intp)
    every[known] = codes
    groups = []
    for pair in present.tolist():
        a, b = first.groups[pair // len(second.groups)], second.groups[pair % len(second.groups)]
        groups.append(Group(f"{a.name}, {b.name}", And(a.node, b.node), (a.name, b.name)))
    return Groups(tuple(groups), every)


def _single(store: Store, grouping: Grouping) -> Groups:
    truth = store.instances
    if grouping == "room":
        rooms = [Group(name, Named(Field("room"), name)) for name in truth.room_names]
        everywhere = Everything()
        outside = Minus(everywhere, any_of(room.node for room in rooms)) if rooms else everywhere
        nowhere = Group(NO_ROOM, outside)
        codes = np.where(truth.room >= 0, truth.room, len(rooms))
        return Groups((*rooms, nowhere), codes)
    if grouping == "heading":
        return Groups(tuple(map(_sector, range(SECTORS))), _sector_codes(truth.heading))
    if grouping == "curvature":
        bend = np.abs(truth.curvature)
        codes = np.where(np.isnan(bend), -1, bend >= STRAIGHT_BELOW)
        return Groups((Group("straight", Bend(True)), Group("curved", Bend(False))), codes)
    names = truth.trajectory_names
    trajectories = tuple(Group(name, Named(Field("traj"), name)) for name in names)
    return Groups(trajectories, truth.trajectory)


def group_errors(
    store: Store, run: str, grouped: Groups, population: NDArray[np.bool_]
) -> tuple[GroupErrors, ...]:
    """Errors of all groups that have instances in `population` (N,), in the order of the groups."""
    columns, pairs = store.run_columns(run), store.dataset.recall_thresholds
    real, found = columns.real, []
    held = severities(real.error, real.heading_error, *pairs[headline_index(len(pairs))]) <= 1
    total = float(np.nansum(real.error[np.flatnonzero(population)]))
    for code, members in members_of(store, grouped, population).items():
        found.append(
            GroupErrors(
                grouped.groups[code],
                members.size,
                real_median(store, run, members),
                float(np.median(columns.sim.error[members])),
                float(np.median(columns.gap[members])),
                float(held[members].mean()),
                float(np.nansum(real.error[members])) / total if total else math.nan,
            )
        )
    return tuple(found)


def real_median(store: Store, run: str, iids: NDArray[np.int64], level: float = LEVEL) -> Interval:
    """Median real error in metres of instances in recording order."""
    errors, trajectory = store.run_columns(run).real.error, store.instances.trajectory
    return intervals.median(errors[iids], trajectory[iids], level=level)


def members_of(
    store: Store, grouped: Groups, population: NDArray[np.bool_]
) -> dict[int, NDArray[np.int64]]:
    """The instances of each group that has any in `population` (N,), in recording order."""
    ordered = store.in_recording_order(population)
    codes = grouped.codes[ordered]
    by_code = np.argsort(codes, kind="stable")
    starts = np.searchsorted(codes[by_code], np.arange(len(grouped.groups) + 1))
    return {
        code: ordered[by_code[start:stop]]
        for code, (start, stop) in enumerate(pairwise(starts))
        if stop > start
    }


def _sector(number: int) -> Group:
    """Headings from half a sector below the centre to half a sector above, that end excluded."""
    width = 360 / SECTORS
    low, high = (_wrapped((number + side) * width) for side in (-0.5, 0.5))
    centre = round(180 - (180 - number * width) % 360)
    ends = (Compare(Field("heading"), ">=", low), Compare(Field("heading"), "<", high))
    return Group(f"{centre} deg", And(*ends) if low < high else Or(*ends))


def _sector_codes(heading: NDArray[np.float64]) -> Codes:
    """The sector of each heading in radians; the comparisons are those of the expressions."""
    width = 360 / SECTORS
    edges = np.sort([_wrapped((number + 0.5) * width) for number in range(SECTORS)])
    above = np.searchsorted(edges * (math.pi / 180), heading, side="right")
    first = round(edges[0] / width - 0.5) + SECTORS  # the sector below the lowest edge
    return np.where(np.isnan(heading), -1, (above + first) % SECTORS)


def _wrapped(degrees: float) -> float:
    return (degrees + 180) % 360 - 180
