"""The history view: the gap G of every night with its interval, and the verdicts of the gate."""

from __future__ import annotations

import datetime
import math
from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import counted, sentence
from s2rstore.gap_history.gate_status import AxisStatus, axis_status, stored_status
from s2rstore.gap_history.reader import AxisFigures, History, Night
from s2rstore.intervals import Interval
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pane, Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Dots, Ink, Line, Mark, Phrase, Plot, Sign
from s2rtui.drawing.scale import Floats, Scale, short_number

HEADLINE = "headline"
LOWEST, HIGHEST = -20.0, 120.0
"""Limits of the scale of G; what lies beyond them is drawn as an arrow at the end of the scale."""
_DATE = 17
"""Columns between dates, of which the last one does not stand in the middle of its day."""
STYLES: dict[AxisStatus, tuple[Sign, Ink]] = {
    "PASS": ("passed", "sim"), "FAIL": ("failed", "real"),
    "INCONCLUSIVE": ("inconclusive", "truth"), "SKIPPED": ("skipped", "muted"),
}  # fmt: skip
_NUMBERS = ("night", "outcome", "axis", "G", "low", "high", "result", "threshold", "value", "unit",
            "n", "evidence days")  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """G (n,) per night with its bounds, NaN where not judged; and the gate's statuses."""

    name: str
    gaps: tuple[Interval, ...]
    statuses: tuple[AxisStatus, ...]

    def column(self, end: str) -> Floats:
        """The values, or bounds, of all nights (n,)."""
        return np.array([getattr(gap, end) for gap in self.gaps], dtype=np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class HistoryModel:
    """The visible nights. days, thresholds: (n,); older: number of hidden nights.

    `scale` of G is common to all tracks.
    """

    days: NDArray[np.float64]
    thresholds: Floats
    tracks: tuple[Track, ...]
    scale: tuple[float, float]
    older: int

    @property
    def is_cut(self) -> bool:
        """Whether a G or a bound of its interval lies beyond the scale."""
        ends = np.concatenate(
            [t.column(end) for t in self.tracks for end in ("value", "low", "high")]
        )
        return bool((ends < self.scale[0]).any() or (ends > self.scale[1]).any())


def history_model(history: Sequence[Night], most_days: int) -> HistoryModel:
    """The nights of the last `most_days` days; `history`: at least one night, oldest first."""
    first = history[-1].night - datetime.timedelta(days=max(1, most_days) - 1)
    nights = history[bisect_left(history, first, key=lambda night: night.night) :]
    headline = Track(HEADLINE, tuple(night.gap for night in nights),
                     tuple(stored_status(night.headline) for night in nights))  # fmt: skip
    tracks = (headline, *(_track(nights, name) for name in _axis_names(nights)))
    days = np.array([float(night.night.toordinal()) for night in nights])
    thresholds = np.array([night.threshold for night in nights])
    older = len(history) - len(nights)
    return HistoryModel(days, thresholds, tracks, _scale(tracks, float(thresholds[-1])), older)


def _axis_names(nights: Sequence[Night]) -> list[str]:
    """All axes that were judged in these nights, in the order of the newest one."""
    axes = (axis for night in reversed(nights) for axis in night.axes)
    return list(dict.fromkeys(axis.axis for axis in axes if not math.isnan(axis.gap.value)))


def _track(nights: Sequence[Night], name: str) -> Track:
    gaps = []
    for night in nights:
        found: AxisFigures | None = next((axis for axis in night.axes if axis.axis == name), None)
        gap = found.gap if found else Interval.unknown()
        gaps.append((gap, axis_status(gap, night.threshold)))
    return Track(name, tuple(gap for gap, _ in gaps), tuple(status for _, status in gaps))


def _scale(tracks: tuple[Track, ...], threshold: float) -> tuple[float, float]:
    ends = np.concatenate([t.column(end) for t in tracks for end in ("value", "low", "high")])
    known = ends[np.isfinite(ends)].tolist()
    top, bottom = max([1.6 * threshold, *known]), min([0.0, *known])
    return max(bottom, LOWEST), min(top, max(HIGHEST, 1.6 * threshold))


def history_plots(model: HistoryModel, columns: int) -> tuple[Plot, ...]:
    """A plot per track, those with the largest G of the last night before others."""
    first, last = float(model.days[0]), float(model.days[-1])
    span = int(last - first) + 1
    step = max(1, -(-span * _DATE // max(1, columns)))
    ticks = [(day, str(datetime.date.fromordinal(int(day))))
             for day in np.arange(last, first - 1, -step)]  # fmt: skip
    x = Scale(first - 0.5, last + 0.5, fixed=tuple(reversed(ticks)))
    low, high = model.scale
    limit = float(model.thresholds[-1])
    labels = {low: short_number(low), 0.0: "0", limit: short_number(limit, 2),
              high: short_number(high, 2)}  # fmt: skip
    names = "gap G (no unit)", "G (no unit)"
    y = Scale(low, high, names, fixed=tuple(sorted(labels.items())))
    plots = []
    for track in model.tracks:
        value = track.gaps[-1].value
        weight = math.inf if track.name == HEADLINE else -math.inf if math.isnan(value) else value
        plots.append(Plot(x, y, tuple(_marks(model, track)), title=_title(track), weight=weight))
    return tuple(plots)


def _marks(model: HistoryModel, track: Track) -> Iterator[Mark]:
    """The threshold, which may change every night, and the nights by their status."""
    ends = np.stack([model.days - 0.499, model.days + 0.499], axis=1).ravel()
    yield Line(ends, np.repeat(model.thresholds, 2), "truth", dashed=True)
    statuses = np.array(track.statuses)
    for status, (sign, ink) in STYLES.items():
        held = np.flatnonzero(statuses == status)
        if held.size:
            gaps = [track.gaps[place] for place in held]
            yield Dots.of(model.days[held], gaps, ink, sign=sign)


def _title(track: Track) -> tuple[Phrase, ...]:
    """The name of the track, and status and G of the last night."""
    sign, ink = STYLES[track.statuses[-1]]
    status = Phrase(track.statuses[-1].lower(), ink, sign)
    last = track.gaps[-1]
    if math.isnan(last.value):
        return Phrase(track.name, "text"), status
    bounds = " .. ".join(f"{end + 0.0:.1f}" for end in (last.low, last.high))
    return (
        Phrase(track.name, "text"),
        status,
        Phrase(f"G {last.value + 0.0:.1f} ({bounds})", "text"),
    )


class HistoryView(View):
    name = "history"
    needs_run = False
    key = "G"
    pane: Pane = "centre"
    description = "the gap over time, night by night"
    title = "the gap over time"
    counts_instances = False
    brushable = False
    loads = ("history",)
    needs_poses = False
    figure_size = (1600, 1100)
    paper_columns = 120

    def subtitle(self, scene: Scene) -> str:
        nights = self.input(scene)
        if not nights:
            return "the gap G, night by night"
        last = nights[-1]
        stale = ", evidence is stale" if last.stale else ""
        shown = f"{counted(len(nights), 'night')} of {last.name}{stale}"
        return f"{shown}: gap G of {last.run} (0: none, 100: anchor)"

    def input(self, scene: Scene) -> tuple[Night, ...]:
        loaded = scene.loaded.history
        if loaded is None:
            return ()
        return _nights(loaded, scene.state.run, scene.store.dataset.name)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        return *super().cache_key(scene), scene.loaded.history, scene.state.history

    def missing(self, scene: Scene) -> tuple[str, ...]:
        loaded, file = scene.loaded.history, scene.state.history
        if self.input(scene):
            return ()
        if failed := scene.loaded.failed.get("history"):
            return ("the history cannot be read", failed)
        if file is not None and loaded is None:
            return ("the history is being loaded",)
        runs = loaded.runs(scene.store.dataset.name) if loaded is not None else ()
        if runs:
            return (f"no night of run {scene.state.run}", f"there are nights of: {', '.join(runs)}")
        if loaded is not None and loaded.nights:
            return ("no night of this data set", "name another history: --history FILE")
        return (
            "no nights yet",
            "s2r nightly CONFIG.toml measures the gap and keeps it in the store: history/gap.jsonl",
        )

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        model = history_model(self.input(scene), columns)
        legend = [Phrase(name.lower(), ink, sign) for name, (sign, ink) in STYLES.items()][:-1]
        legend.append(Phrase("dashes: threshold", "truth"))
        if model.is_cut:
            legend.append(Phrase("arrows: off scale"))
        if model.older:
            legend.append(Phrase(f"{model.older} older"))
        return Drawing(history_plots(model, columns), notes=(tuple(legend),))

    def numbers(self, scene: Scene) -> Table:
        return _NUMBERS, [row for night in self.input(scene) for row in _rows(night)]

    def summary(self, scene: Scene) -> str:
        nights = self.input(scene)
        if not nights:
            return f"{sentence('; '.join(self.missing(scene)))}."
        last = nights[-1]
        passed = sum(night.outcome == "PASS" for night in nights)
        days = counted(last.evidence_age, "day")
        text = f"Night {last.night}: {last.outcome}"
        if last.worst is not None:
            gap = " .. ".join(f"{end:.1f}" for end in (last.gap.low, last.gap.high))
            text += f", gap G {last.gap.value:.1f} ({gap}), worst axis {last.worst}"
        return f"{text}; {passed} of {len(nights)} nights passed; evidence is {days} old."

    def heading(self, scene: Scene) -> tuple[str, str]:
        return f"{scene.state.run}: {self.title}", self.summary(scene)


@lru_cache(4)
def _nights(loaded: History, run: str, dataset: str) -> tuple[Night, ...]:
    return loaded.of_run(run, dataset)


def _rows(night: Night) -> Iterator[tuple[object, ...]]:
    """The headline, then every axis of a night."""
    yield _row(night, HEADLINE, night.gap, stored_status(night.headline), None, None, None)
    for axis in night.axes:
        status = axis_status(axis.gap, night.threshold)
        value = None if math.isnan(axis.value.value) else axis.value.value
        shown = axis.state if axis.state != "measured" else status
        yield _row(night, axis.axis, axis.gap, shown, value, axis.unit, axis.n)


def _row(
    night: Night, axis: str, gap: Interval, status: str, value: float | None, unit: str | None,
    n: int | None,
) -> tuple[object, ...]:  # fmt: skip
    figures = (gap.value, gap.low, gap.high, status, night.threshold, value, unit, n)
    return (str(night.night), night.outcome, axis, *figures, night.evidence_age)


VIEW = HistoryView()
