"""The numbers of the history view: the gap G over time, overall and per axis."""

from __future__ import annotations

import datetime
import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.gap_history.gate_status import AxisStatus, axis_status, stored_status
from s2rstore.gap_history.reader import AxisFigures, Night
from s2rstore.intervals import Interval

HEADLINE = "headline"
LOWEST, HIGHEST = -20.0, 120.0
"""Limits of the scale of G; what lies beyond them is drawn at the end of the scale and marked."""
_NOTHING = Interval.unknown()
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """G (n,) per night with its bounds, NaN where not judged; and the gate's statuses."""

    name: str
    value: Floats
    low: Floats
    high: Floats
    statuses: tuple[AxisStatus, ...]

    @property
    def last(self) -> Interval:
        """The interval of the newest night."""
        return Interval(float(self.low[-1]), float(self.value[-1]), float(self.high[-1]))


@dataclass(frozen=True, slots=True, eq=False)
class HistoryModel:
    """The visible nights. days: (n,) ordinals; thresholds: (n,); older: number of hidden nights.

    `scale` is common to all tracks.
    """

    days: NDArray[np.intp]
    thresholds: Floats
    tracks: tuple[Track, ...]
    scale: tuple[float, float]
    older: int

    def beyond(self, value: float) -> int:
        """1 where a G lies above the scale, -1 below it, else 0."""
        return int(value > self.scale[1]) - int(value < self.scale[0])

    @property
    def is_cut(self) -> bool:
        """Whether a G or a bound of its interval lies beyond the scale."""
        ends = (end for track in self.tracks for end in (track.value, track.low, track.high))
        return any(self.beyond(value) for column in ends for value in column.tolist())

    @property
    def span(self) -> int:
        """Days from the first to the last visible night, both included."""
        return int(self.days[-1] - self.days[0]) + 1


def history_model(history: Sequence[Night], most_days: int) -> HistoryModel:
    """The nights of the last `most_days` days; `history`: at least one night, oldest first."""
    newest = history[-1].night
    first = newest - datetime.timedelta(days=max(1, most_days) - 1)
    nights = history[bisect_left(history, first, key=lambda night: night.night) :]
    thresholds = np.array([night.threshold for night in nights])
    headline = _track(HEADLINE, [(night.gap, stored_status(night.headline)) for night in nights])
    axes = [axis_of(nights, name) for name in axis_names(nights)]
    tracks = (headline, *axes)
    days = np.array([night.night.toordinal() for night in nights], dtype=np.intp)
    older = len(history) - len(nights)
    return HistoryModel(days, thresholds, tracks, _scale(tracks, thresholds), older)


def axis_names(nights: Sequence[Night]) -> list[str]:
    """All axes that were judged in these nights, in the order of the newest one."""
    axes = (axis for night in reversed(nights) for axis in night.axes)
    return list(dict.fromkeys(axis.axis for axis in axes if not math.isnan(axis.gap.value)))


def figures_of(night: Night, axis: str) -> AxisFigures | None:
    """One axis of a night."""
    return next((each for each in night.axes if each.axis == axis), None)


def axis_of(nights: Sequence[Night], name: str) -> Track:
    """The track of one axis."""
    gaps = []
    for night in nights:
        figures = figures_of(night, name)
        gap = figures.gap if figures else _NOTHING
        gaps.append((gap, axis_status(gap, night.threshold)))
    return _track(name, gaps)


def _track(name: str, gaps: list[tuple[Interval, AxisStatus]]) -> Track:
    columns = np.array([(gap.value, gap.low, gap.high) for gap, _ in gaps]).reshape(-1, 3)
    statuses = tuple(status for _, status in gaps)
    return Track(name, columns[:, 0], columns[:, 1], columns[:, 2], statuses)


def _scale(tracks: tuple[Track, ...], thresholds: Floats) -> tuple[float, float]:
    ends = np.concatenate([part for t in tracks for part in (t.value, t.low, t.high)])
    known = ends[np.isfinite(ends)]
    top = max([1.6 * float(thresholds[-1]), *known.tolist()])
    bottom = min([0.0, *known.tolist()])
    return max(bottom, LOWEST), min(top, max(HIGHEST, 1.6 * float(thresholds[-1])))
