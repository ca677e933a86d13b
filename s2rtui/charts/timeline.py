"""The timeline view: both errors along the trajectory of the cursor's instance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from s2rstore.language.canonical_text import quoted
from s2rstore.records import SIDES, Side
from s2rtui.analysis.binning import Bools
from s2rtui.analysis.identity_cache import cached_by_identity
from s2rtui.canvas import BrushShape, PlotArea, Point
from s2rtui.charts.mark_expressions import number_text
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.planes import valid_cursor
from s2rtui.charts.view import Table, View
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.plot import Dots, Line, Mark, Phrase, Plot, Rule
from s2rtui.drawing.scale import Floats, Scale, non_empty
from s2rtui.session.session import Session

PANEL = "timeline"
Iids = NDArray[np.intp]
Column = NDArray[np.float64]
_NO_POSES = "the instances have no trajectory"


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """The instances in view of one trajectory by `seq`: iids (n,), and errors (n,) in metres.

    A gap in `seq` of more than one step is a row of NaN without an iid (-1), where lines end.
    """

    name: str
    iids: Iids
    seq: Column
    errors: dict[Side, Column]
    sigma: Column


@cached_by_identity(4)
def timeline(
    name: str, code: int, trajectory: NDArray[np.integer], seq: NDArray[np.integer],
    sim: Floats, real: Floats, sigma: Floats, base: Bools,
) -> Timeline:  # fmt: skip
    """The timeline of the trajectory with a code, over the base population (N,)."""
    iids = np.flatnonzero((trajectory == code) & base)
    iids = iids[np.argsort(seq[iids], kind="stable")]
    steps = np.diff(seq[iids])
    gaps = np.flatnonzero(steps > (np.median(steps) if steps.size else 1)) + 1
    at = np.insert(seq[iids].astype(np.float64), gaps, np.nan)

    def with_gaps(column: Floats) -> Column:
        return np.insert(column[iids].astype(np.float64), gaps, np.nan)

    errors = {side: with_gaps(each) for side, each in zip(SIDES, (sim, real), strict=True)}
    return Timeline(name, np.insert(iids, gaps, -1), at, errors, with_gaps(sigma))


class TimelineView(View):
    name = PANEL
    key = ";"
    description = "timeline: both errors along the trajectory of the instance"
    title = "errors along a trajectory"

    def subtitle(self, scene: Scene) -> str:
        found = self.input(scene)
        return "" if found is None else f"errors along {found.name}"

    def input(self, scene: Scene) -> Timeline | None:
        """The timeline of the cursor's trajectory, else of that of the first instance in view."""
        state, truth = scene.state, scene.store.instances
        cursor = valid_cursor(state.cursor, state.base)
        if cursor is None:
            in_view = np.flatnonzero(state.base & (truth.trajectory >= 0))
            cursor = int(in_view[0]) if in_view.size else None
        if cursor is None or truth.trajectory[cursor] < 0:
            return None
        columns, code = scene.store.run_columns(state.run), int(truth.trajectory[cursor])
        return timeline(
            truth.trajectory_names[code], code, truth.trajectory, truth.seq, columns.sim.error,
            columns.real.error, columns.real.sigma, state.base,
        )  # fmt: skip

    def missing(self, scene: Scene) -> tuple[str, ...]:
        return (_NO_POSES,) if self.input(scene) is None else ()

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        found = self.input(scene)
        assert found is not None
        cursor = valid_cursor(scene.state.cursor, scene.state.base)
        known = found.iids >= 0
        notes = [Phrase(f"{np.count_nonzero(known)} instances in view")]
        if not scene.state.selected[found.iids[known]].all():
            notes.append(Phrase("dots: selected", "real"))
        if cursor is not None:
            notes.append(Phrase(f"line: instance {cursor}", "cursor"))
        plot = _plot(found, scene.state.selected, cursor)
        return Drawing((plot,), notes=(tuple(notes),), brush=scene.mark(self.name))

    def numbers(self, scene: Scene) -> Table:
        names = ("trajectory", "seq", "iid", "sim_error_m", "real_error_m", "real_sigma_m")
        found = self.input(scene)
        if found is None:
            return names, []
        rows = np.flatnonzero(found.iids >= 0)
        errors = [found.errors[side][rows].tolist() for side in SIDES]
        seq, iids = found.seq[rows].astype(int).tolist(), found.iids[rows].tolist()
        columns = (seq, iids, *errors, found.sigma[rows].tolist())
        return names, [(found.name, *row) for row in zip(*columns, strict=True)]

    def summary(self, scene: Scene) -> str:
        found = self.input(scene)
        if found is None:
            return f"{_NO_POSES}."
        largest = []
        for side, errors in found.errors.items():
            if np.isfinite(errors).any():
                at = int(np.nanargmax(errors))
                largest.append(f"{side} {errors[at]:.2f} m at seq {found.seq[at]:g}")
        return f"{found.name}: largest errors {', '.join(largest) or 'unknown'}."

    def cursor_point(self, scene: Scene, panel: PlotArea) -> Point | None:
        found = self.input(scene)
        if found is None:
            return None
        rows = np.flatnonzero(found.iids == scene.state.cursor)
        return (float(found.seq[rows[0]]), 0.0) if rows.size else None

    def _nearest(self, scene: Scene, seq: float) -> int | None:
        found = self.input(scene)
        if found is None:
            return None
        known = np.flatnonzero(found.iids >= 0)
        return int(found.iids[known[np.argmin(np.abs(found.seq[known] - seq))]])

    def instance_at(self, scene: Scene, panel: PlotArea, cell: Point) -> int | None:
        return self._nearest(scene, panel.to_data(*cell)[0])

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        nearest = self._nearest(scene, point[0])
        if nearest is not None:
            session.set_cursor(nearest)

    def to_expression(self, scene: Scene, panel: PlotArea, mark: BrushShape) -> str:
        found = self.input(scene)
        if found is None:
            return "none"
        low, high = sorted(round(point[0]) for point in (mark.points[0], mark.points[-1]))
        ends = f"{number_text(max(0, low))}..{number_text(max(0, high))}"
        return f"traj:{quoted(found.name)} & seq:{ends}"


def _plot(found: Timeline, selected: Bools, cursor: int | None) -> Plot:
    known = found.iids >= 0
    chosen = known & selected[found.iids]
    x = Scale(
        *non_empty(float(np.nanmin(found.seq)), float(np.nanmax(found.seq))),
        ("seq (no unit)", "seq"),
    )
    highest = max(np.nanmax(each, initial=0.0) for each in found.errors.values()) or 1.0
    y = Scale(0.0, 1.05 * float(highest), ("position error (m)", "error (m)", "m"))
    marks: list[Mark] = []
    if cursor is not None and (at := found.seq[found.iids == cursor]).size:
        marks.append(Rule(float(at[0]), ink="cursor"))
    if np.isfinite(found.sigma).any():
        marks.append(Line(found.seq, found.sigma, "real", "sigma", dashed=True))
    marks += [Line(found.seq, found.errors[side], side, side) for side in SIDES]
    if not chosen[known].all():
        marks.append(Dots(found.seq[chosen], found.errors["real"][chosen], "real", sign="selected"))
    return Plot(x, y, tuple(marks), PANEL)


VIEW = TimelineView()
