"""The history of the gap: the results of every night and the verdicts of the gate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import lru_cache
from textwrap import wrap

from s2rstore.errors import RequestError, counted, sentence
from s2rstore.gap_history.gate_status import axis_status, stored_status
from s2rstore.gap_history.reader import History, Night
from s2rstore.intervals import Interval
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.charts.history import terminal
from s2rtui.charts.scene import Scene
from s2rtui.charts.view import Pane, Pixels, Table, View

_COLUMNS = ("night", "outcome", "axis", "G", "low", "high", "result", "threshold", "value", "unit",
            "n", "evidence days")  # fmt: skip


class HistoryView(View):
    name = "history"
    needs_run = False
    key = "G"
    pane: Pane = "centre"
    description = "the gap over time, night by night"
    narrow_ratio = 1.6
    wide_ratio = 0.8
    counts_instances = False
    loads = ("history",)
    needs_poses = False
    figure_size = (1600, 1100)

    def subtitle(self, scene: Scene) -> str:
        nights = self.input(scene)
        if not nights:
            return "the gap G, night by night"
        last = nights[-1]
        stale = ", evidence is stale" if last.stale else ""
        shown = f"{counted(len(nights), 'night')} of {last.name}{stale}"
        return f"{shown}: gap G of {last.run} (0: none, 100: anchor)"

    def input(self, scene: Scene) -> tuple[Night, ...]:
        loaded = scene.resources.history
        if loaded is None:
            return ()
        return _nights(loaded, scene.state.run, scene.store.dataset.name)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        failed = scene.resources.failed.get("history")
        return scene.resources.history, scene.state.run, scene.state.history, failed

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        if nights := self.input(scene):
            return terminal.draw_history(nights, size, options)
        canvas = Canvas(*size, options)
        lines = [part for line in self._missing(scene) for part in wrap(line, canvas.width)]
        for row, line in enumerate(lines):
            canvas.text(0, row, line, options.theme.muted if row else options.theme.text)
        return canvas

    def _missing(self, scene: Scene) -> tuple[str, ...]:
        """The lines that say why there is nothing to draw and what to do."""
        loaded, file = scene.resources.history, scene.state.history
        if failed := scene.resources.failed.get("history"):
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
            "s2r nightly CONFIG.toml measures the gap and keeps it in the store: "
            "history/gap.duckdb",
        )

    def numbers(self, scene: Scene) -> Table:
        rows = [row for night in self.input(scene) for row in _rows(night)]
        return _COLUMNS, rows

    def summary(self, scene: Scene) -> str:
        nights = self.input(scene)
        if not nights:
            text = "; ".join(self._missing(scene))
            return f"{sentence(text)}."
        last = nights[-1]
        passed = sum(night.outcome == "PASS" for night in nights)
        days = counted(last.evidence_age, "day")
        text = f"Night {last.night}: {last.outcome}"
        if last.worst is not None:
            gap = " .. ".join(f"{end:.1f}" for end in (last.gap.low, last.gap.high))
            text += f", gap G {last.gap.value:.1f} ({gap}), worst axis {last.worst}"
        return f"{text}; {passed} of {len(nights)} nights passed; evidence is {days} old."

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.history import paper

        nights = self.input(scene)
        if not nights:
            raise RequestError(f"--view history: {'; '.join(self._missing(scene))}")
        title = f"{scene.state.run}: the gap over time"
        return paper.history_figure(nights, size, theme, title, self.summary(scene))


VIEW = HistoryView()


@lru_cache(4)
def _nights(loaded: History, run: str, dataset: str) -> tuple[Night, ...]:
    return loaded.of_run(run, dataset)


def _rows(night: Night) -> Iterator[tuple[object, ...]]:
    """The headline, then every axis of a night."""
    yield _row(night, "headline", night.gap, stored_status(night.headline), None, None, None)
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
