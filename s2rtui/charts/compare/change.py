"""How errors change from one run to another, in words and by room.

A change is the error of the second run, B, minus that of the first, A, on the same instance:
negative where B is better.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.rooms import NO_ROOM
from s2rstore.metrics import bootstrap
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.charts.shared.axis_scale import Floats, short_number

EQUAL = 0.05
"""Metres within which two errors count as equal."""
LARGE = 0.5
"""Metres; the share of instances that change by more is stated."""
ALL = "all"
NOT_EVIDENT, UNKNOWN = "no", "too few"
Codes = NDArray[np.integer]


@dataclass(frozen=True, slots=True)
class Change:
    """The change of errors over `n` instances, metres; numbers are NaN where n is 0.

    first, second: median error of each run; first_mean, second_mean: its mean. change: median of
    the changes B - A with its 95 % interval, NaN bounds where there are too few instances. better,
    worse: instances on which the error of B is smaller, or larger, by more than the margin of
    equality. large: the share of instances, 0 .. 1, whose error changes by more than `LARGE`.
    """

    n: int
    first: float
    second: float
    change: bootstrap.Interval
    better: int
    worse: int
    large: float
    first_mean: float
    second_mean: float

    @property
    def equal(self) -> int:
        return self.n - self.better - self.worse

    @property
    def better_run(self) -> str:
        """`A` or `B` where the interval of the median change excludes 0, else an empty text."""
        if self.change.high < 0:
            return "B"
        return "A" if self.change.low > 0 else ""


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
) -> RoomChanges:
    """Compare errors (N,) of the instances `members` (N,) bool; unknown errors are left out.

    trajectory, room: (N,) codes of the trajectory and of the true room, -1 for none; None where
    all instances have the same trajectory, or where there are no rooms. equal: metres within which
    two errors count as equal.
    """
    known = np.flatnonzero(members & np.isfinite(first) & np.isfinite(second))
    codes = np.zeros(len(first), dtype=np.int64) if trajectory is None else trajectory
    known = known[np.argsort(codes[known], kind="stable")]  # recording order
    one, two = (np.asarray(errors, dtype=np.float64)[known] for errors in (first, second))
    whole = change(one, two, codes[known], equal)
    rooms = []
    if room is not None:
        for code, name in [*enumerate(room_names), (-1, NO_ROOM)]:
            inside = room[known] == code
            if inside.any():
                part = change(one[inside], two[inside], codes[known[inside]], equal)
                rooms.append((name, part))
    return RoomChanges(whole, tuple(rooms))


def change(first: Floats, second: Floats, trajectory: Codes, equal: float = EQUAL) -> Change:
    """Compare known errors (n,) in recording order; trajectory: (n,) codes, equal: metres."""
    apart = second - first
    n = apart.size
    return Change(
        n=n,
        first=float(np.median(first)) if n else math.nan,
        second=float(np.median(second)) if n else math.nan,
        change=bootstrap.median_interval(apart, trajectory),
        better=int(np.count_nonzero(apart < -equal)),
        worse=int(np.count_nonzero(apart > equal)),
        large=float(np.mean(np.abs(apart) > LARGE)) if n else math.nan,
        first_mean=float(first.mean()) if n else math.nan,
        second_mean=float(second.mean()) if n else math.nan,
    )


def words(
    whole: Change, names: tuple[str, str], side: str, unit: str = "m", equal: float = EQUAL
) -> str:
    """The comparison of the runs `names` in sentences; `equal` as in `room_changes`."""
    a, b = names
    head = f"{side.capitalize()} errors of {a} (A) and {b} (B)"
    if not whole.n:
        return f"{head}: no instance with both errors is selected."
    interval = "" if math.isnan(whole.change.low) else f"95 % interval {interval_text(whole)}; "
    verdict = {
        "A": f"so {a} is evidently better",
        "B": f"so {b} is evidently better",
        "": "which is no evident difference",
    }[whole.better_run]
    return (
        f"{head}: {b} is better on {whole.better} of {whole.n} instances, worse on {whole.worse}, "
        f"within {equal:g} {unit} on {whole.equal}. Median change B - A: "
        f"{signed(whole.change.value)} {unit} ({interval}negative: {b} is better), {verdict}. "
        f"{100 * whole.large:.0f} % of the instances change by more than {LARGE:g} {unit}."
    )


def interval_text(part: Change) -> str:
    """`-0.61 to -0.20`; empty without an interval."""
    if math.isnan(part.change.low):
        return ""
    return f"{signed(part.change.low)} to {signed(part.change.high)}"


def evidence(part: Change) -> str:
    """`B better`, `A better`, `NOT_EVIDENT`, or `UNKNOWN` where there are too few instances."""
    if math.isnan(part.change.low):
        return UNKNOWN
    return f"{part.better_run} better" if part.better_run else NOT_EVIDENT


def signed(value: float) -> str:
    """A change in metres with its sign; 0 without one."""
    text = f"{value:+.2f}"
    return "0.00" if text in ("+0.00", "-0.00") else text


HEADINGS = ("room", "n", "A m", "B m", "B - A m", "95 % interval", "evident")
"""Columns of the table of rooms, in which A and B are medians and B - A is the median change."""


def table_rows(rooms: Sequence[tuple[str, Change]], whole: Change) -> list[tuple[str, ...]]:
    """The table of rooms as text, all instances last."""
    return [
        (
            name,
            str(part.n),
            short_number(part.first),
            short_number(part.second),
            signed(part.change.value),
            interval_text(part),
            evidence(part),
        )
        for name, part in [*rooms, (ALL, whole)]
    ]
