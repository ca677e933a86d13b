"""The gap over time as numbers: a track for the headline and one for every axis."""

from __future__ import annotations

import datetime
import math
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.gap_history.gate_status import Word, known_word, word_of
from s2rstore.gap_history.reader import AxisFigures, Night
from s2rstore.metrics.pose_metrics import Interval

HEADLINE = "headline"
LOWEST, HIGHEST = -20.0, 120.0
"""G is clipped to these for display only."""
_NOTHING = Interval(math.nan, math.nan, math.nan)
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class HistoryInput:
    """The nights of one run, oldest first, each once."""

    nights: tuple[Night, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """G per night, (n,) with its bounds, unclipped, NaN where it was not judged; and the words."""

    name: str
    value: Floats
    low: Floats
    high: Floats
    words: tuple[Word, ...]

    @property
    def last(self) -> Interval:
        """The newest night's."""
        return Interval(float(self.value[-1]), float(self.low[-1]), float(self.high[-1]))


@dataclass(frozen=True, slots=True, eq=False)
class HistoryModel:
    """days: (n,) ordinals of the nights in view, thresholds: (n,); `older` nights are not in view.

    `scale` is that of all tracks: G is made to be compared.
    """

    days: NDArray[np.intp]
    thresholds: Floats
    tracks: tuple[Track, ...]
    scale: tuple[float, float]
    older: int

    @property
    def span(self) -> int:
        """Days from the first to the last night in view, both included."""
        return int(self.days[-1] - self.days[0]) + 1


def history_model(data: HistoryInput, most_days: int) -> HistoryModel:
    """The last `most_days` days up to the newest night. `data` must hold a night."""
    newest = data.nights[-1].night
    first = newest - datetime.timedelta(days=max(1, most_days) - 1)
    nights = data.nights[bisect_left(data.nights, first, key=lambda night: night.night) :]
    thresholds = np.array([night.threshold for night in nights])
    headline = _track(HEADLINE, [(night.gap, known_word(night.headline)) for night in nights])
    axes = [axis_of(nights, name) for name in axis_names(nights)]
    tracks = (headline, *axes)
    days = np.array([night.night.toordinal() for night in nights], dtype=np.intp)
    older = len(data.nights) - len(nights)
    return HistoryModel(days, thresholds, tracks, _scale(tracks, thresholds), older)


def axis_names(nights: Sequence[Night]) -> list[str]:
    """Every axis that one of these nights has judged, in the newest one's order."""
    axes = (axis for night in reversed(nights) for axis in night.axes)
    return list(dict.fromkeys(axis.axis for axis in axes if not math.isnan(axis.gap.value)))


def figures_of(night: Night, axis: str) -> AxisFigures | None:
    """One axis of a night."""
    return next((each for each in night.axes if each.axis == axis), None)


def axis_of(nights: Sequence[Night], name: str) -> Track:
    """The track of one axis."""
    found = []
    for night in nights:
        figures = figures_of(night, name)
        gap = figures.gap if figures else _NOTHING
        found.append((gap, word_of(gap, night.threshold)))
    return _track(name, found)


def _track(name: str, found: list[tuple[Interval, Word]]) -> Track:
    columns = np.array([(gap.value, gap.low, gap.high) for gap, _ in found]).reshape(-1, 3)
    words = tuple(word for _, word in found)
    return Track(name, columns[:, 0], columns[:, 1], columns[:, 2], words)


def _scale(tracks: tuple[Track, ...], thresholds: Floats) -> tuple[float, float]:
    ends = np.concatenate([part for t in tracks for part in (t.value, t.low, t.high)])
    known = ends[np.isfinite(ends)]
    top = max([1.6 * float(thresholds[-1]), *known.tolist()])
    bottom = min([0.0, *known.tolist()])
    return max(bottom, LOWEST), min(top, max(HIGHEST, 1.6 * float(thresholds[-1])))
