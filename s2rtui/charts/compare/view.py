"""The comparison of two runs on one selection: where each has the smaller errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from s2rstore.errors import RequestError
from s2rtui.analysis.identity_cache import identity_key
from s2rtui.canvas import Canvas, Panel, RenderOptions, Size, Theme
from s2rtui.charts.compare.model import CompareInput, compare_model
from s2rtui.charts.compare.terminal import compare_panels, draw_compare
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.axis_scale import Floats
from s2rtui.charts.shared.base_map_model import MapInput, map_input, value_range
from s2rtui.charts.shared.base_map_terminal import draw_value_map
from s2rtui.charts.shared.points import true_positions
from s2rtui.charts.view import Pane, Pixels, PointsView, Table
from s2rtui.session import pending_target, run_comparison

_WIDE, _TALL = 56, 30
_EQUAL = 0.05
"""Metres within which two errors count as equal."""


class CompareView(PointsView):
    name = "compare"
    key = "9"
    pane: Pane = "centre"
    description = "two runs compared on the selection"
    narrow_ratio = 1.6
    wide_ratio = 1.0
    loads = ("floor plan",)
    figure_size = (2100, 900)
    deprecated = MappingProxyType(
        {
            "first mean": "first_mean_m",
            "second mean": "second_mean_m",
            "difference": "difference_m",
        }
    )

    def subtitle(self, scene: Scene) -> str:
        other = run_comparison.other_run(scene.state)
        if other is None:
            return "there is only one run"
        return f"{scene.state.side} errors of {scene.state.run} and {other} (k: other run, d: side)"

    def pair_input(self, scene: Scene, other: str) -> CompareInput:
        """The errors of the current and of another run."""
        store, state = scene.store, scene.state
        first, second = (store.run_columns(run).side(state.side) for run in (state.run, other))
        return CompareInput(
            true_positions(store), first.error, second.error, state.selected, state.base,
            store.dataset.bounds, (state.run, other), state.side, equal=_EQUAL,
            cursor=state.cursor, y_down=store.dataset.y_down,
            floor_plan=scene.resources.floor_plan, rooms=store.rooms,
            room_names=state.room_names, mark=scene.mark(self.name),
        )  # fmt: skip

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state, other = scene.state, run_comparison.other_run(scene.state)
        if other is None:
            return ()
        if not pending_target.run_is_loaded(scene.store, other):
            return other, "loading"
        return state.generation, identity_key(self.pair_input(scene, other)), state.viewport

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        canvas = Canvas(*size, options)
        other = run_comparison.other_run(scene.state)
        if other is None:
            canvas.text(0, 0, "nothing to compare with", options.theme.muted)
            return canvas
        if not pending_target.run_is_loaded(scene.store, other):
            canvas.text(0, 0, f"loading run {other}", options.theme.muted)
            return canvas
        notes = run_comparison.differences(scene.store, scene.state.run, other)
        top = min(len(notes), max(0, size[1] - 3))
        for row, note in enumerate(notes[:top]):
            canvas.text(0, row, note[: canvas.width], options.theme.truth)
        height = canvas.height - top
        maps = height // 2 if self._both(size) else 0
        if maps:
            half = (canvas.width - 2) // 2
            for x, errors in zip((0, half + 2), self.maps(scene, other), strict=True):
                canvas.paste(
                    draw_value_map(errors, (half, maps), options, scene.state.viewport), x, top
                )
        view = self.pair_input(scene, other)
        shown = draw_compare(view, (canvas.width, height - maps), options, scene.state.viewport)
        canvas.paste(shown, 0, top + maps)
        return canvas

    def _both(self, size: Size) -> bool:
        return size[0] >= _WIDE and size[1] >= _TALL

    def maps(self, scene: Scene, other: str) -> tuple[MapInput, MapInput]:
        """The maps of both runs, coloured by their errors on a common scale."""
        store, state = scene.store, scene.state
        runs = (state.run, other)
        errors = [store.run_columns(run).side(state.side).error for run in runs]
        upper = max(value_range(column, state.base)[1] for column in errors)
        first, second = (
            replace(
                map_input(
                    store, replace(state, run=run, map_mode="colour"), scene.resources.floor_plan
                ),
                values=column,
                value_label=f"{run}, error",
                value_range=(0.0, upper),
            )
            for run, column in zip(runs, errors, strict=True)
        )
        return first, second

    def summary(self, scene: Scene) -> str:
        other = run_comparison.other_run(scene.state)
        if other is None:
            return "There is only one run."
        summary = compare_model(self.pair_input(scene, other)).summary
        mean = "n/a" if math.isnan(summary.mean) else f"{summary.mean:+.2f} m"
        return (
            f"{scene.state.side.capitalize()} errors of {scene.state.run} and {other}: {other} is "
            f"better on {summary.improved} instances, worse on {summary.worse}, equal on "
            f"{summary.equal}; mean difference {mean}."
        )

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.compare import paper

        other = run_comparison.other_run(scene.state)
        if other is None:
            raise RequestError("--view compare: there is only one run")
        notes = tuple(run_comparison.differences(scene.store, scene.state.run, other))
        return paper.compare_figure(
            self.maps(scene, other), self.pair_input(scene, other), size, theme,
            subtitle=scene.caption, notes=notes, viewport=scene.state.viewport,
        )  # fmt: skip

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[Panel]:
        other = run_comparison.other_run(scene.state)
        if other is None or not pending_target.run_is_loaded(scene.store, other):
            return ()
        notes = run_comparison.differences(scene.store, scene.state.run, other)
        top = min(len(notes), max(0, size[1] - 3))
        maps = (size[1] - top) // 2 if self._both(size) else 0
        inner = (size[0], size[1] - top - maps)
        panels = compare_panels(self.pair_input(scene, other), inner, options, scene.state.viewport)
        return [panel.moved_down(top + maps) for panel in panels]

    def numbers(self, scene: Scene) -> Table:
        names = ("room", "n", *self.deprecated.values(), "improved", "worse", "equal")
        other = run_comparison.other_run(scene.state)
        if other is None:
            return names, []
        view, truth = self.pair_input(scene, other), scene.store.instances
        known = view.selected & view.valid & np.isfinite(view.first) & np.isfinite(view.second)
        rows = []
        for code, name in [*enumerate(truth.room_names), (-1, "no room"), (None, "all")]:
            members = known if code is None else known & (truth.room == code)
            if members.any() or code is None:
                rows.append((name, *_summary(view.first[members], view.second[members])))
        return names, rows


VIEW = CompareView()


def _summary(first: Floats, second: Floats) -> tuple[object, ...]:
    """n, both means and their difference; how many improved, got worse, stayed equal."""
    apart = first - second
    better, worse = int((apart > _EQUAL).sum()), int((apart < -_EQUAL).sum())
    n = first.size
    means = (float(part.mean()) if n else math.nan for part in (first, second, apart))
    return (n, *means, better, worse, n - better - worse)
