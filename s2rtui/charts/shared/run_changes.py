"""How errors change from one run to another, in words and by room.

A change is the error of the second run, B, minus that of the first, A, on the same instance:
negative where B is better.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore import intervals
from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.intervals import Interval
from s2rtui.analysis.binning import (
    Bins,
    Bools,
    SelectionIndices,
    bin_values,
    count_selected,
    selection_indices,
    sum_selected,
    take,
)
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.analysis.ranked_column import RankedColumn, ranked_column, select_ranks
from s2rtui.canvas.fit_text import fit_text
from s2rtui.drawing.scale import Floats

EQUAL = 0.05
"""Metres within which two errors count as equal."""
LARGE = 0.5
"""Metres; the share of instances that change by more is stated."""
ALL = "all"
_LONGEST = 32
"""Most cells of the name of a run in a sentence."""
NOT_EVIDENT, UNKNOWN, NOT_JUDGED = "no", "too few", "not judged"
_MOST_SORTED = 20_000
"""Most changes that an interval sorts; those of more are sorted once for all selections."""
Codes = NDArray[np.integer]


@dataclass(frozen=True, slots=True)
class Change:
    """The change of errors over `n` instances, metres; numbers are NaN where n is 0.

    first, second: median error of each run; first_mean, second_mean: its mean. change: median of
    the changes B - A with its 95 % interval, NaN bounds where there are too few instances. better,
    worse: instances on which the error of B is smaller, or larger, by more than the margin of
    equality. large: the share of instances, 0 .. 1, whose error changes by more than `LARGE`.
    is_judged: whether a verdict is given. Instances that were selected by errors give none: those
    on which A is the worst by chance make B look better.
    """

    n: int
    first: float
    second: float
    change: Interval
    better: int
    worse: int
    large: float
    first_mean: float
    second_mean: float
    is_judged: bool = True

    @property
    def equal(self) -> int:
        return self.n - self.better - self.worse

    @property
    def better_run(self) -> str:
        """`A` or `B` where the interval of the median change excludes 0, else an empty text."""
        if not self.is_judged:
            return ""
        if self.change.is_negative:
            return "B"
        return "A" if self.change.is_positive else ""


@dataclass(frozen=True, slots=True)
class RoomChanges:
    """The change over all instances, and per room in the order of the store."""

    whole: Change
    rooms: tuple[tuple[str, Change], ...]

    @property
    def by_size(self) -> list[tuple[str, Change]]:
        """Rooms with an evident change first, in both groups by the size of the median change."""
        return sorted(
            self.rooms,
            key=lambda room: (not room[1].better_run, -abs(room[1].change.value)),
        )


@cached_by_identity(8)
def room_changes(
    first: Floats,
    second: Floats,
    members: Bools,
    trajectory: Codes | None,
    room: Codes | None,
    room_names: tuple[str, ...],
    equal: float = EQUAL,
    is_judged: bool = True,
) -> RoomChanges:
    """Compare errors (N,) of the instances `members` (N,) bool; unknown errors are left out.

    trajectory, room: (N,) codes of the trajectory and of the true room, -1 for none; None where
    all instances have the same trajectory, or where there are no rooms. equal: metres within which
    two errors count as equal.
    """
    names = () if room is None else (*room_names, NO_ROOM)
    columns = _columns(first, second, trajectory, room, max(1, len(names)), equal)
    chosen = np.asarray(members) & columns.known
    changes = _Changes(columns, selection_indices(chosen, columns.known), chosen, is_judged)
    rooms = [(name, changes.part(code)) for code, name in enumerate(names) if changes.numbers[code]]
    return RoomChanges(changes.part(None), tuple(rooms))


@dataclass(frozen=True, slots=True, eq=False)
class _Columns:
    """What all selections share: errors of two runs, sorted and in groups, which are the rooms.

    known: (N,) the instances with both errors; the others are NaN in `apart`, the difference of
    `first` and `second`. groups: as they are for all runs. by_group: group codes of the known.
    verdicts: group * 6 + 2 * (0 better, 1 equal, 2 worse) + whether the change is large. ranked:
    `first`, `second` and `apart` in bins of ranks.
    """

    known: Bools
    first: Floats
    second: Floats
    apart: Floats
    groups: _Groups
    by_group: Bins
    verdicts: Bins
    ranked: tuple[RankedColumn, ...]


@cached_by_identity(2)
def _columns(
    first: Floats,
    second: Floats,
    trajectory: Codes | None,
    room: Codes | None,
    count: int,
    equal: float,
) -> _Columns:
    """The columns of two runs in `count` groups; instances without a room are in the last."""
    one, two = _as_float64(first), _as_float64(second)
    apart = two - one
    known: Bools = np.isfinite(apart)
    groups = _groups(trajectory, room, len(apart), count)
    verdict = np.where(np.abs(apart) > equal, np.sign(apart), 0) + 1
    places = groups.codes * 6 + 2 * verdict + (np.abs(apart) > LARGE)
    return _Columns(
        known, one, two, apart, groups,
        bin_values(np.where(known, groups.codes, np.nan), count),
        bin_values(np.where(known, places, np.nan), 6 * count),
        (
            _ranked(one, groups.codes, count),
            _ranked(two, groups.codes, count),
            ranked_column(apart, groups.codes, count),
        ),
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Groups:
    """The rooms of all instances, whatever the runs: codes (N,), and the trajectory's codes (N,).

    rows: the iids of each group in recording order, those of all groups last.
    """

    codes: Codes
    trajectory: Codes
    rows: tuple[NDArray[np.intp], ...]


@cached_by_identity(2)
def _groups(trajectory: Codes | None, room: Codes | None, size: int, count: int) -> _Groups:
    """`count` groups of `size` instances; those without a room are in the last."""
    codes = np.zeros(size, dtype=np.uint16)
    if room is not None:
        codes = np.where(room < 0, count - 1, room).astype(np.uint16)
    order = np.arange(size)
    if trajectory is not None:
        order = np.argsort(trajectory, kind="stable")  # recording order
    by_group = order[np.argsort(codes[order], kind="stable")]
    rows = np.split(by_group, np.cumsum(np.bincount(codes, minlength=count))[:-1])
    lines = np.zeros(size, dtype=np.int64) if trajectory is None else trajectory
    return _Groups(codes, lines, (*rows, order))


_ranked = cached_by_identity(8)(ranked_column)
"""Errors of a run, which several pairs of runs share."""


@cached_by_identity(8)
def _as_float64(errors: Floats) -> NDArray[np.float64]:
    return np.asarray(errors, dtype=np.float64)


class _Changes:
    """The changes of one selection, `members` (N,) bool, which have both errors."""

    def __init__(
        self, columns: _Columns, selection: SelectionIndices, members: Bools, is_judged: bool
    ) -> None:
        self._columns, self._members, self._is_judged = columns, members, is_judged
        verdicts, _ = count_selected(columns.verdicts, selection)
        self._verdicts = verdicts.reshape(-1, 3, 2)
        self.numbers = self._verdicts.sum(axis=(1, 2))
        """Members of each group."""
        self._ranks = [select_ranks(column, selection, members) for column in columns.ranked]
        self._sums = [
            sum_selected(columns.by_group, errors, selection)
            for errors in (columns.first, columns.second)
        ]

    def part(self, group: int | None) -> Change:
        """The change of the members of a group, or of all."""
        verdicts = self._verdicts.sum(axis=0) if group is None else self._verdicts[group]
        better, _, worse = verdicts.sum(axis=1).tolist()
        n = int(verdicts.sum())
        sums = (float(total.sum() if group is None else total[group]) for total in self._sums)
        first_mean, second_mean = (total / n if n else math.nan for total in sums)
        return Change(
            n=n,
            first=self._ranks[0].median(group),
            second=self._ranks[1].median(group),
            change=self._interval(group, n),
            better=better,
            worse=worse,
            large=int(verdicts[:, 1].sum()) / n if n else math.nan,
            first_mean=first_mean,
            second_mean=second_mean,
            is_judged=self._is_judged,
        )

    def _interval(self, group: int | None, n: int) -> Interval:
        """The median change; the changes of many instances are sorted already."""
        columns, ranks = self._columns, self._ranks[2]
        rows = columns.groups.rows[-1 if group is None else group]
        chosen = rows[take(self._members, rows)]
        apart = take(columns.apart, chosen)
        trajectory = take(columns.groups.trajectory, chosen)
        if n <= _MOST_SORTED:
            return intervals.median(apart, trajectory)
        return intervals.ranked_quantile(
            apart, ranks.median(group), 0.5, trajectory, lambda rank: ranks.value(rank - 1, group)
        )


def sentences(
    whole: Change, names: tuple[str, str], side: str, unit: str = "m", equal: float = EQUAL
) -> str:
    """The comparison of the runs `names` in sentences; `equal` as in `room_changes`."""
    a, b = (fit_text(name, _LONGEST, "…") for name in names)
    head = f"{side.capitalize()} errors of {a} (A) and {b} (B)"
    if not whole.n:
        return f"{head}: no instance with both errors is selected."
    interval = f"95 % interval {interval_text(whole)}; " if whole.change.is_known else ""
    verdict = {
        "A": f"so {a} is evidently better",
        "B": f"so {b} is evidently better",
        "": f"which is no evident difference{_doubt(whole.change)}",
    }[whole.better_run]
    if not whole.is_judged:
        verdict = "which is not judged, because the instances were selected by predictions"
    return (
        f"{head}: {b} is better on {whole.better} of {whole.n} instances, worse on {whole.worse}, "
        f"within {equal:g} {unit} on {whole.equal}. Median change B - A: "
        f"{signed(whole.change.value)} {unit} ({interval}negative: {b} is better), {verdict}. "
        f"{100 * whole.large:.0f} % of the instances change by more than {LARGE:g} {unit}."
    )


def _doubt(change: Interval) -> str:
    """Why an interval on one side of 0 is not evident; empty for other intervals."""
    return "" if change.is_known else f": {change.bounds_text()}"


def interval_text(part: Change) -> str:
    """`-0.61 to -0.20`, as `Interval.bound_texts` says; empty without an interval."""
    if not part.change.is_known:
        return ""
    return " to ".join(part.change.bound_texts(signed))


def evidence(part: Change) -> str:
    """`B better`, `A better`, `NOT_EVIDENT`, `UNKNOWN` of too few instances, or `NOT_JUDGED`."""
    if not part.is_judged:
        return NOT_JUDGED
    if not part.change.is_known:
        return UNKNOWN
    return f"{part.better_run} better" if part.better_run else NOT_EVIDENT


def signed(value: float) -> str:
    """A change in metres with its sign; 0 without one."""
    text = f"{value:+.2f}"
    return "0.00" if text in ("+0.00", "-0.00") else text
