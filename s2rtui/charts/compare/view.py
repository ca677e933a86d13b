"""The comparison of two runs on one selection: where each has the smaller errors.

A run without another one is compared with its baseline, the constant prediction of the mean
position.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace

from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import identity_key
from s2rtui.canvas import Canvas, PlotArea, RenderOptions, Size, Theme
from s2rtui.charts.compare.change import ALL, Change, evidence, interval_text
from s2rtui.charts.compare.model import CompareInput, constant_errors
from s2rtui.charts.compare.terminal import (
    compare_panels,
    comparison_text,
    draw_compare,
    layout_text,
)
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.base_map_model import MapInput, map_input, value_range
from s2rtui.charts.shared.base_map_terminal import draw_value_map
from s2rtui.charts.shared.point_bins import own_positions, true_positions
from s2rtui.charts.view import Pane, Pixels, PointsView, Table, TableWindow
from s2rtui.drawing.scale import Floats
from s2rtui.session import run_comparison, targets
from s2rtui.session.view_settings import ZoomPlane, map_plane

_WIDE, _TALL = 56, 40
"""Columns and rows from which the maps of both runs are drawn, too."""
_MAP_ROWS = 8
"""Fewest rows of a map; lower views show sentences and table alone."""
BASELINE = "baseline"
"""The name of the constant prediction where it takes the place of the other run."""
_MAP_SHARE = 0.6
"""Share of the rows of a high view that sentences and table leave to the maps; 0.4 of a low one."""


class CompareView(PointsView):
    name = "compare"
    key = "9"
    pane: Pane = "centre"
    description = "two runs, or a run and its baseline, compared on the selection"
    narrow_ratio = 3.2
    wide_ratio = 1.1
    loads = ("floor plan",)
    figure_size = (2100, 1200)

    def subtitle(self, scene: Scene) -> str:
        other = run_comparison.other_run(scene.state)
        state = scene.state
        if other is None:
            return f"{state.side} errors of the only run and of its constant {BASELINE} (d: side)"
        text = f"{state.side} errors of {state.run} and {other} (k: other run, d: side)"
        if not targets.run_is_loaded(scene.store, other):
            return text
        return "; ".join(part for part in (text, scene.other_trained_note(other)) if part)

    def pair_input(self, scene: Scene, other: str | None) -> CompareInput:
        """The errors of the current run, and of another one or (None) of its baseline."""
        store, state = scene.store, scene.state
        first, second = self._errors(scene, other)
        return CompareInput(
            true_positions(store), first, second, state.selected, _base(scene, other),
            store.dataset.bounds, (state.run, other or BASELINE), state.side,
            cursor=state.cursor, y_down=store.dataset.y_down,
            floor_plan=scene.loaded.floor_plan, rooms=store.rooms,
            room_names=state.room_names, mark=scene.mark(self.name),
            trajectory=store.instances.trajectory, room=store.instances.room,
            room_list=store.instances.room_names, trained=_marked(scene, other),
            first_room=state.first_row(self.name) or 0,
        )  # fmt: skip

    def _errors(self, scene: Scene, other: str | None) -> tuple[Floats, Floats]:
        """The errors (N,) of both runs on the side that is shown, metres."""
        store, state = scene.store, scene.state
        columns = store.run_columns(state.run)
        first = columns.side(state.side).error
        if other is not None:
            return first, store.run_columns(other).side(state.side).error
        own = own_positions(store, store.run(state.run).domain(state.side))
        points = true_positions(store) if own is None else own
        return first, constant_errors(points, columns.valid, columns.trained)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state, other = scene.state, run_comparison.other_run(scene.state)
        if not _is_loaded(scene, other):
            return other, "loading"
        return state.generation, identity_key(self.pair_input(scene, other)), state.viewport

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        canvas = Canvas(*size, options)
        other = run_comparison.other_run(scene.state)
        if not _is_loaded(scene, other):
            canvas.text(0, 0, f"loading run {other}", options.theme.muted)
            return canvas
        view = self.pair_input(scene, other)
        text = self._text(scene, other, view, size, options)
        canvas.paste(text, 0, 0)
        if not self._has_map(size):
            return canvas
        top = text.height
        height = canvas.height - top
        maps = height // 2 if self._both(size) else 0
        if maps:
            half = (canvas.width - 2) // 2
            for x, errors in zip((0, half + 2), self.maps(scene, other), strict=True):
                canvas.paste(
                    draw_value_map(errors, (half, maps), options, scene.state.viewport), x, top
                )
        shown = draw_compare(view, (canvas.width, height - maps), options, scene.state.viewport)
        canvas.paste(shown, 0, top + maps)
        return canvas

    def _text(
        self,
        scene: Scene,
        other: str | None,
        view: CompareInput,
        size: Size,
        options: RenderOptions,
    ) -> Canvas:
        """What differs between the runs' cameras, the comparison in words, and its table."""
        notes, room = self._text_rows(scene, other, size)
        words = comparison_text(view, (max(1, size[0]), room), options)
        canvas = Canvas(words.width, len(notes) + words.height, options)
        for row, note in enumerate(notes):
            canvas.text(0, row, note, options.theme.truth)
        canvas.paste(words, 0, len(notes))
        return canvas

    def _text_rows(self, scene: Scene, other: str | None, size: Size) -> tuple[list[str], int]:
        """The notes on the cameras, and the most rows of sentences and table below them."""
        height = max(1, size[1])
        lines = [
            line
            for note in _camera_notes(scene, other)
            for line in textwrap.wrap(note, max(10, size[0]))
        ]
        notes = lines[: max(0, height - 3)]
        share = _MAP_SHARE if self._both(size) else 1 - _MAP_SHARE
        map_rows = int(share * height) if self._has_map(size) else 0
        return notes, max(1, height - len(notes) - map_rows)

    def table_window(self, scene: Scene, size: Size, options: RenderOptions) -> TableWindow | None:
        other = run_comparison.other_run(scene.state)
        if not _is_loaded(scene, other):
            return None
        view, (_, room) = self.pair_input(scene, other), self._text_rows(scene, other, size)
        layout = layout_text(view, (max(1, size[0]), room), options)
        return TableWindow(layout.first, layout.shown, len(view.changes.rooms))

    def _has_map(self, size: Size) -> bool:
        """Whether there is room for a map below sentences and table."""
        return int((1 - _MAP_SHARE) * size[1]) >= _MAP_ROWS

    def _both(self, size: Size) -> bool:
        return size[0] >= _WIDE and size[1] >= _TALL

    def maps(self, scene: Scene, other: str | None) -> tuple[MapInput, MapInput]:
        """The maps of both runs, coloured by their errors on a common scale."""
        store, state = scene.store, scene.state
        errors = self._errors(scene, other)
        base, trained = _base(scene, other), _marked(scene, other)
        upper = max(value_range(column, base)[1] for column in errors)
        first, second = (
            replace(
                map_input(
                    store,
                    replace(state, run=run or state.run, map_mode="colour"),
                    scene.loaded.floor_plan,
                ),
                values=column,
                valid=base,
                trained=trained,
                value_label=f"{run or BASELINE}, error",
                value_range=(0.0, upper),
            )
            for run, column in zip((state.run, other), errors, strict=True)
        )
        return first, second

    def summary(self, scene: Scene) -> str:
        other = run_comparison.other_run(scene.state)
        left_out = "" if other is None else scene.other_trained_note(other)
        return self.pair_input(scene, other).sentences + (f" {left_out}." if left_out else "")

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        from s2rtui.charts.compare import paper

        other = run_comparison.other_run(scene.state)
        left_out = "" if other is None else scene.other_trained_note(other)
        notes = (left_out, *_camera_notes(scene, other))
        return paper.compare_figure(
            self.maps(scene, other), self.pair_input(scene, other), size, theme,
            subtitle=scene.caption, notes=notes, viewport=scene.state.viewport,
        )  # fmt: skip

    def zoom_plane(self, scene: Scene) -> ZoomPlane:
        return map_plane(scene.store, scene.state)

    def panels(self, scene: Scene, size: Size, options: RenderOptions) -> Sequence[PlotArea]:
        other = run_comparison.other_run(scene.state)
        if not _is_loaded(scene, other) or not self._has_map(size):
            return ()
        view = self.pair_input(scene, other)
        top = self._text(scene, other, view, size, options).height
        maps = (size[1] - top) // 2 if self._both(size) else 0
        inner = (size[0], size[1] - top - maps)
        panels = compare_panels(view, inner, options, scene.state.viewport)
        return [panel.moved_down(top + maps) for panel in panels]

    def numbers(self, scene: Scene) -> Table:
        names = ("room", "n", "first_median_m", "second_median_m", "median_change_m", "low_m",
                 "high_m", "evident", "improved", "worse", "equal", "large_share", "first_mean_m",
                 "second_mean_m", "bounds")  # fmt: skip
        other = run_comparison.other_run(scene.state)
        changes = self.pair_input(scene, other).changes
        rows = [(name, *_numbers(part)) for name, part in (*changes.rooms, (ALL, changes.whole))]
        return names, rows


VIEW = CompareView()


def _marked(scene: Scene, other: str | None) -> Bools | None:
    """The shown instances that the model of either run was trained on; None without any."""
    return scene.state.marked if other is None else scene.common_marked(other)


def _base(scene: Scene, other: str | None) -> Bools:
    """(N,) the instances that are compared: those of the base population in both runs."""
    return scene.state.base if other is None else scene.common_base(other)


def _is_loaded(scene: Scene, other: str | None) -> bool:
    return other is None or targets.run_is_loaded(scene.store, other)


def _camera_notes(scene: Scene, other: str | None) -> list[str]:
    """How the cameras of both runs differ, a line per side."""
    if other is None:
        return []
    return run_comparison.differences(scene.store, scene.state.run, other)


def _numbers(part: Change) -> tuple[object, ...]:
    """The numbers of a row: counts, medians and interval in metres, the run that is better.

    `bounds` is the interval as text, with `<` or `>` where few blocks do not bound it.
    """
    interval = part.change
    return (
        part.n, part.first, part.second, interval.value, *interval.bounds,
        part.better_run or evidence(part), part.better, part.worse, part.equal, part.large,
        part.first_mean, part.second_mean, interval_text(part),
    )  # fmt: skip
