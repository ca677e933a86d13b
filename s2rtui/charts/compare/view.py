"""Two runs on one selection: where the one errs less than the other, and who got worse."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from s2rstore.errors import RequestError
from s2rtui.analysis.identity_cache import identity
from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.canvas.brush_surface import Mark, Panel, Point
from s2rtui.charts.compare.model import difference_model
from s2rtui.charts.compare.terminal import difference, difference_surface
from s2rtui.charts.map.model import value_range
from s2rtui.charts.map.terminal import geomap
from s2rtui.charts.shared import inputs, view_inputs
from s2rtui.charts.shared.inputs import Floats
from s2rtui.charts.view import Pane, Pixels, Scene, Table, View, area
from s2rtui.session import Session, pending_target, run_differences

_WIDE, _TALL = 56, 30
_EQUAL = 0.05
"""Metres within which two errors count as equal."""


class CompareView(View):
    name = "compare"
    key = "9"
    pane: Pane = "centre"
    description = "two runs compared on the selection"
    feeds = ("floor plan",)
    paper = (2100, 900)

    def told(self, scene: Scene) -> str:
        other = run_differences.other_run(scene.state)
        if other is None:
            return "there is only one run"
        return f"{scene.state.run} and {other}, {scene.state.side}: k another run, d side"

    def input(self, scene: Scene, other: str) -> inputs.DifferenceInput:
        store, state = scene.store, scene.state
        first, second = (store.run_columns(run).side(state.side) for run in (state.run, other))
        return inputs.DifferenceInput(
            view_inputs.truth_points(store), first.error, second.error, state.selected, state.base,
            store.dataset.bounds, (state.run, other), state.side, equal=_EQUAL,
            cursor=state.cursor, y_down=store.dataset.y_down,
            floor_plan=scene.resources.floor_plan, rooms=store.rooms,
            room_names=state.room_names, mark=scene.mark(self.name),
        )  # fmt: skip

    def depends(self, scene: Scene) -> tuple[object, ...]:
        state, other = scene.state, run_differences.other_run(scene.state)
        if other is None:
            return ()
        if not pending_target.run_is_loaded(scene.store, other):
            return other, "loading"
        return state.generation, identity(self.input(scene, other)), state.viewport

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        canvas = Canvas(*size, theme=look.theme)
        other = run_differences.other_run(scene.state)
        if other is None:
            canvas.text(0, 0, "nothing to compare with", look.theme.muted)
            return canvas
        if not pending_target.run_is_loaded(scene.store, other):
            canvas.text(0, 0, f"loading run {other}", look.theme.muted)
            return canvas
        notes = run_differences.differences(scene.store, scene.state.run, other)
        for row, note in enumerate(notes[: max(0, canvas.height - 3)]):
            canvas.text(0, row, note[: canvas.width], look.theme.truth)
        top = self._top(scene, size)
        height = canvas.height - top
        maps = height // 2 if self._both(size) else 0
        if maps:
            half = (canvas.width - 2) // 2
            for x, one in zip((0, half + 2), self.maps(scene, other), strict=True):
                drawn = geomap(one, (half, maps), look, scene.state.viewport)
                canvas.paste(drawn, x, top)
        view = self.input(scene, other)
        shown = difference(view, (canvas.width, height - maps), look, scene.state.viewport)
        canvas.paste(shown, 0, top + maps)
        return canvas

    def _both(self, size: Size) -> bool:
        return size[0] >= _WIDE and size[1] >= _TALL

    def _top(self, scene: Scene, size: Size) -> int:
        """Rows that the notes on cameras take."""
        other = run_differences.other_run(scene.state)
        notes = run_differences.differences(scene.store, scene.state.run, other) if other else []
        return min(len(notes), max(0, size[1] - 3))

    def maps(self, scene: Scene, other: str) -> tuple[inputs.GeoMapInput, inputs.GeoMapInput]:
        """Both runs' maps, coloured by their errors on one scale."""
        store, state = scene.store, scene.state
        runs = (state.run, other)
        errors = [store.run_columns(run).side(state.side).error for run in runs]
        upper = max(value_range(column, state.base)[1] for column in errors)
        first, second = (
            replace(
                view_inputs.map_input(
                    store, replace(state, run=run, map_mode="colour"), scene.resources.floor_plan
                ),
                values=column,
                value_label=f"{run}, error",
                value_range=(0.0, upper),
            )
            for run, column in zip(runs, errors, strict=True)
        )
        return first, second

    def words(self, scene: Scene) -> str:
        other = run_differences.other_run(scene.state)
        if other is None:
            return "There is only one run."
        found = difference_model(self.input(scene, other)).summary
        mean = "n/a" if math.isnan(found.mean) else f"{found.mean:+.2f} m"
        return (
            f"{scene.state.side.capitalize()} errors of {scene.state.run} and {other}: {other} is "
            f"better on {found.improved} instances, worse on {found.worse}, equal on "
            f"{found.equal}; mean difference {mean}."
        )

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.compare import paper

        other = run_differences.other_run(scene.state)
        if other is None:
            raise RequestError("--view compare: there is only one run")
        notes = tuple(run_differences.differences(scene.store, scene.state.run, other))
        return paper.compare_figure(
            self.maps(scene, other), self.input(scene, other), size, theme,
            subtitle=scene.caption, notes=notes, viewport=scene.state.viewport,
        )  # fmt: skip

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        other = run_differences.other_run(scene.state)
        if other is None or not pending_target.run_is_loaded(scene.store, other):
            return ()
        top = self._top(scene, size)
        maps = (size[1] - top) // 2 if self._both(size) else 0
        inner = (size[0], size[1] - top - maps)
        panels = difference_surface(self.input(scene, other), inner, look, scene.state.viewport)
        return [run_differences.lowered(panel, top + maps) for panel in panels]

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        return view_inputs.point_of(view_inputs.truth_points(scene.store), scene.state.cursor)

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        points = view_inputs.truth_points(scene.store)
        nearest = view_inputs.nearest(points, scene.state.base, point)
        if nearest is not None:
            session.set_cursor(nearest)

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        return area(panel, mark, "box", "lasso")

    def numbers(self, scene: Scene) -> Table:
        names = ("room", "n", "first mean", "second mean", "difference", "improved", "worse",
                 "equal")  # fmt: skip
        other = run_differences.other_run(scene.state)
        if other is None:
            return names, []
        view, truth = self.input(scene, other), scene.store.instances
        known = view.selected & view.valid & np.isfinite(view.first) & np.isfinite(view.second)
        rows = []
        for code, name in [*enumerate(truth.room_names), (-1, "no room"), (None, "all")]:
            members = known if code is None else known & (truth.room == code)
            if members.any() or code is None:
                rows.append((name, *_summary(view.first[members], view.second[members])))
        return names, rows


def _summary(first: Floats, second: Floats) -> tuple[object, ...]:
    """n, both means, their difference, and how many improved, got worse, stayed equal."""
    difference = first - second
    better, worse = int((difference > _EQUAL).sum()), int((difference < -_EQUAL).sum())
    n = first.size
    means = (float(part.mean()) if n else math.nan for part in (first, second, difference))
    return (n, *means, better, worse, n - better - worse)
