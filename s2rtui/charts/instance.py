"""The instance view: images, heat and predictions of one instance on both sides."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import NotComputedError, RequestError
from s2rstore.heatmap_kinds import heatmap_facts
from s2rstore.index.columns import RunColumns
from s2rstore.index.population import NEW_INSTANCES, Population
from s2rstore.metrics import nearest_neighbours
from s2rstore.metrics.heatmap_scores import trust_line
from s2rstore.metrics.object_gains import instance_gains
from s2rstore.reader import Store
from s2rstore.records import NO_RUN, SIDES, SPLITS, Bounds, Side
from s2rstore.security.printable_text import printable
from s2rtui.canvas import Canvas, PlotArea, Point, RenderOptions, Size, Theme
from s2rtui.charts.scene import Scene
from s2rtui.charts.shared.instance import (
    InstanceInput,
    PoseNumbers,
    SideView,
    heat_fields,
    image_shape,
    instance_drawing,
    truth_fields,
)
from s2rtui.charts.shared.object_mark import mark_note, object_mark
from s2rtui.charts.view import Pixels, Table, View
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.drawing import Drawing
from s2rtui.session import images
from s2rtui.session.model_input import ModelInput, model_input, stored_image
from s2rtui.session.population_values import population_ranks
from s2rtui.session.provenance import instance_provenance
from s2rtui.session.session import Session
from s2rtui.session.state import HeatChoice
from s2rtui.session.view_settings import ZoomPlane

NEIGHBOURS = 5
"""Number of most similar instances that are listed and selected."""
_PLACES = 4
"""Regions whose metres are listed."""
_ROWS = ("top", "", "bottom")
_COLUMNS = ("left", "", "right")
_TEXT_ROWS = 16
"""Rows of titles, colour bars, poses and notes."""


def instance_input(
    store: Store,
    run: str,
    iid: int,
    heat: HeatChoice | None,
    population: Population = NEW_INSTANCES,
    at_source: bool = False,
    label: str | None = None,
) -> InstanceInput:
    """Images, heat and numbers of one instance; reads frames and heatmaps.

    `population` holds the instances that may be named as similar to this one. A note says so where
    the heat of this instance is not computed. at_source: whether images have the size of their
    source, where it is stored. label: a class of objects that is marked.
    """
    if not store.has_poses:
        return _image_input(store, iid, at_source)
    truth = store.instances
    room = truth.room[iid]
    trajectory = truth.trajectory_names[truth.trajectory[iid]]
    shown = store.displayed_run(run)
    sim, real = (model_input(store, shown, side, iid, at_source) for side in SIDES)
    missing: tuple[tuple[str, str], ...] = ()
    try:
        heats = {side: _heat(store, run, side, iid, heat) for side in SIDES}
    except NotComputedError as error:
        heats, missing = dict.fromkeys(SIDES), (("heat", str(error)),)
        if not all(store.is_imaged(shown.domain(side), iid) for side in SIDES):
            missing = (("heat", f"needs images in {shown.sim_domain} and {shown.real_domain}"),)
    marks = {side: object_mark(store, run, side, iid, label) for side in SIDES if label is not None}
    harm = _harm_note(heat, heats["real"], float(store.run_columns(run).real.error[iid]))
    return InstanceInput(
        iid=iid,
        sim=replace(_side(store, run, iid, "sim", heats["sim"], sim), **marks.get("sim", {})),
        real=replace(_side(store, run, iid, "real", heats["real"], real), **marks.get("real", {})),
        **truth_fields(store, run, iid),
        **heat_fields(store, run, None if missing else heat),
        notes=(
            *missing,
            *mark_note(label, marks),
            *_heat_note(store, run, None if missing else heat),
            *harm,
            *(_objects_note(store, run, iid) if harm else ()),
            ("where", f"{trajectory} {truth.seq[iid]}, {_named(truth.room_names, int(room))}"),
            *_pair_note(store, iid),
            *_predicted_notes(store, run, iid, population),
            *sim.notes,
            *real.notes,
        ),
    )


def _predicted_notes(
    store: Store, run: str, iid: int, population: Population
) -> list[tuple[str, str]]:
    """Split, gap, ranks and neighbours of an instance in a run, or why there are none."""
    if run == NO_RUN:
        return [("predictions", f"none: {store.missing_run}")]
    columns = store.run_columns(run)
    numbers = [("gap", _gap(columns, iid)), ("ranks", _ranks(store, run, iid, population))]
    neighbours = _neighbours(store, run, iid, population)
    return [*_split_note(columns, iid), *numbers, *neighbours]


def _heat_note(store: Store, run: str, heat: HeatChoice | None) -> list[tuple[str, str]]:
    """What the shown heatmap means and how far it can be trusted; nothing without one."""
    text = trust_line(store, run, heat.kind, heat.mode) if heat is not None else ""
    return [("heat", text)] if text else []


def _harm_note(
    choice: HeatChoice | None, heat: NDArray[np.float32] | None, error: float
) -> list[tuple[str, str]]:
    """A line on how many metres each changed part of the real image costs; empty for other heat.

    Parts in the same place of the image are added up, the largest sums first; fine heat has no
    parts. Positive metres make the estimate worse. `error` is the real error in metres, of which
    the line says what the sum of the heat leaves.
    """
    if choice is None or heat is None or not heatmap_facts(choice.kind).sums_up:
        return []
    if choice.mode not in (None, "position"):  # the others are radians and loss
        return []
    values = np.nan_to_num(np.asarray(heat, dtype=np.float64))
    total = f"changes cost {values.sum():+.2f} m"
    if values.any() and math.isfinite(error):
        total += f", without these {error:.2f} -> {max(0.0, error - values.sum()):.2f} m"
    if choice.kind == "harm_fine":
        return [("harm", total)]
    gains: dict[str, float] = {}
    for region in connected_regions(values != 0):
        place = place_in_image(region)
        gains[place] = gains.get(place, 0.0) + float(values[region].sum())
    places = sorted(gains, key=lambda place: -abs(gains[place]))
    shown = [f"{gains[place]:+.2f} m {place}" for place in places[:_PLACES]]
    more = f", {len(places) - _PLACES} more" if len(places) > _PLACES else ""
    return [("harm", f"{total}: {', '.join(shown)}{more}" if shown else "no changed part")]


def _objects_note(store: Store, run: str, iid: int) -> list[tuple[str, str]]:
    """The labelled objects that cost or save the most metres; nothing without any."""
    gains = [(name, gain) for name, gain in instance_gains(store, run, iid) if abs(gain) >= 0.005]
    shown = [f"{gain:+.2f} m {name}" for name, gain in gains[:_PLACES]]
    more = [f"{len(gains) - _PLACES} more"] if len(gains) > _PLACES else []
    return [("objects", ", ".join([*shown, *more]))] if shown else []


def _split_note(columns: RunColumns, iid: int) -> list[tuple[str, str]]:
    """The split of an instance that the run's model was trained on; else nothing."""
    if not columns.trained[iid]:
        return []
    return [("split", f"{SPLITS[columns.split[iid]]}: the model was trained on it")]


def _pair_note(store: Store, iid: int) -> list[tuple[str, str]]:
    """The offset of a loose pair, whose images show the scene from two poses; else nothing."""
    offset = store.pair_offset(iid)
    return [("pair", f"sim pose {offset} from the real one")] if offset else []


def _image_input(store: Store, iid: int, at_source: bool) -> InstanceInput:
    """The images of an instance without pose, and where they come from."""
    truth = store.instances
    sim, real = (stored_image(store, side, iid, at_source) for side in SIDES)
    notes = [("where", f"{truth.trajectory_names[truth.trajectory[iid]]} {truth.seq[iid]}")]
    if not math.isnan(time := float(truth.timestamp[iid])):
        notes.append(("time", f"{time:.3f} s"))
    query = "SELECT domain, rgb_path FROM frame WHERE iid = ? ORDER BY domain"
    notes += [
        (f"{printable(domain)} file", printable(path))
        for domain, path in store.execute(query, [iid])
        if path is not None
    ]
    return InstanceInput(
        iid=iid,
        sim=SideView(rgb=sim.rgb, title=sim.title),
        real=SideView(rgb=real.rgb, title=real.title),
        notes=(*notes, *sim.notes, *real.notes),
    )


def _named(names: tuple[str, ...], code: int) -> str:
    return names[code] if code >= 0 else "no room"


def _gap(columns: RunColumns, iid: int) -> str:
    missing = [side for side in SIDES if math.isnan(columns.side(side).error[iid])]
    if missing:
        return f"unknown: no {' and no '.join(missing)} prediction"
    gap, shift = columns.gap[iid], columns.shift[iid]
    return f"{gap:+.2f} m (real - sim error), shift {shift:.2f} m"


def _ranks(store: Store, run: str, iid: int, population: Population) -> str:
    """Ranks among the new instances; among all of them where these are included."""
    columns = store.run_columns(run)
    if population.leaves_out_trained(columns) and not columns.trained[iid]:
        places = [population_ranks(population, columns, side) for side in SIDES]
        sim, real = (int(column[iid]) or "none" for column in places)
        return f"sim {sim}, real {real} of {int(places[1].max())} new instances by error"
    totals = {side: int(np.isfinite(columns.side(side).error).sum()) for side in SIDES}
    ranks = {side: columns.side(side).rank[iid] or "none" for side in SIDES}
    trained = int(np.count_nonzero(columns.valid & columns.trained))
    known = f" by error, {trained} trained on included" if trained else " by error"
    if totals["sim"] == totals["real"]:
        return f"sim {ranks['sim']}, real {ranks['real']} of {totals['real']}{known}"
    return ", ".join(f"{side} {ranks[side]} of {totals[side]}" for side in SIDES) + known


def _neighbours(store: Store, run: str, iid: int, population: Population) -> list[tuple[str, str]]:
    """The most similar instances by embedding on each side; nothing without embeddings."""
    sides = []
    for side in SIDES:
        try:
            near, _ = nearest_neighbours.neighbours(store, run, side, iid, NEIGHBOURS, population)
        except NotComputedError:
            return []
        listed = " ".join(str(other) for other in near if other != iid)
        sides.append(f"{side} {listed or 'none'}")
    return [("alike", ", ".join(sides))]


def _heat(
    store: Store, run: str, side: Side, iid: int, heat: HeatChoice | None
) -> NDArray[np.float32] | None:
    """The chosen heatmap of one side. Raises NotComputedError where it is not computed."""
    return None if heat is None else store.heatmap(run, heat.kind, side, iid, heat.mode)


def _side(
    store: Store,
    run: str,
    iid: int,
    side: Side,
    heat: NDArray[np.float32] | None,
    shown: ModelInput,
) -> SideView:
    part = store.run_columns(run).side(side)
    values = [part.x, part.y, part.heading, part.error, part.heading_error]
    x, y, heading, error, turn = (float(column[iid]) for column in values)
    return SideView(
        rgb=shown.rgb,
        depth=shown.depth,
        heat=heat,
        pose=None if math.isnan(x) else PoseNumbers(x, y, heading, error, turn),
        title=shown.title,
        original=shown.original,
    )


def connected_regions(mask: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    """The regions of a mask (h, w) whose cells touch by sides or corners, as masks (h, w).

    Each cell takes the smallest number among its neighbours until none changes.
    """
    numbers = np.where(mask, np.arange(1, mask.size + 1).reshape(mask.shape), 0)
    largest = mask.size + 1
    while True:
        padded = np.pad(np.where(mask, numbers, largest), 1, constant_values=largest)
        rows = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
        lowest = np.minimum(np.minimum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
        # Numbers of cells are passed on, so that long regions take few rounds.
        known = np.append(0, np.where(mask, lowest, 0).ravel())
        passed = np.where(mask, known[np.where(mask, lowest, 0)], 0)
        if np.array_equal(passed, numbers):
            break
        numbers = passed
    return [numbers == number for number in np.unique(numbers[mask])]


def place_in_image(region: NDArray[np.bool_]) -> str:
    """Where the centre of a region (h, w) lies, by thirds: `top left`, `right`, `middle`."""
    rows, columns = np.nonzero(region)
    height, width = region.shape
    row = _ROWS[min(2, int(3 * (rows.mean() + 0.5) / height))]
    column = _COLUMNS[min(2, int(3 * (columns.mean() + 0.5) / width))]
    return " ".join(filter(None, (row, column))) or "middle"


class InstanceView(View):
    name = "instance"
    needs_run = False
    key = "3"
    description = "one instance: pictures, heat, poses, errors, ranks, neighbours"
    counts_instances = False
    loads = ("pictures",)
    single_instance = True
    brushable = False
    needs_poses = False
    figure_size = (1600, 1200)

    def subtitle(self, scene: Scene) -> str:
        """The source of the images; long titles are cut."""
        state, resources = scene.state, scene.loaded
        if state.cursor is None:
            return "none"
        requested = instance_provenance(state).label(state)
        failed = resources.failed.get("pictures")
        if resources.pictures is None or resources.pictures_source is None:
            return f"{requested}: {failed}" if failed else f"{requested}, loading"
        present = resources.pictures_source.label(state)
        if present == requested:
            return present
        return f"{present} ({requested}: {failed})" if failed else present

    def loading(self, scene: Scene) -> str:
        """By what the images being loaded differ from those that are shown."""
        shown = scene.loaded.pictures_source
        if shown is None or "pictures" in scene.loaded.failed or scene.state.cursor is None:
            return ""
        return instance_provenance(scene.state).difference(shown)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        shown = scene.loaded.pictures
        remark = scene.remark(shown.iid) if shown else ""
        state = scene.state
        settings = state.images.arrangement, state.images.front, state.images.divider
        return shown, state.cursor is None, remark, *settings, state.viewport_of(self.name)

    def numbers(self, scene: Scene) -> Table:
        names = ("what", "x_m", "y_m", "heading_deg", "error_m", "heading_error_deg", "note")
        shown = scene.loaded.pictures
        if shown is None:
            return names, []
        rows: list[tuple[object, ...]] = []
        for label, (x, y, heading) in shown.truths:
            rows.append((label, x, y, math.degrees(heading), None, None, None))
        for role, side in shown.sides:
            if (pose := side.pose) is not None:
                turns = math.degrees(pose.heading), math.degrees(pose.heading_error)
                rows.append((role, pose.x, pose.y, turns[0], pose.error, turns[1], None))
        notes = [*shown.notes, ("remark", scene.remark(shown.iid))]
        return names, rows + [(name, *[None] * 5, text) for name, text in notes if text]

    def summary(self, scene: Scene) -> str:
        shown = scene.loaded.pictures
        if shown is None:
            return "No instance."
        sides = [
            f"{role} error {side.pose.error:.2f} m and {math.degrees(side.pose.heading_error):.1f} "
            "degrees"
            for role, side in shown.sides
            if side.pose is not None
        ]
        notes = dict(shown.notes)
        where = "; ".join(notes[name] for name in ("where", "split") if name in notes)
        if not scene.store.has_poses:
            sides = [
                f"image in {view.title or role}" for role, view in shown.sides if view.rgb.size
            ]
        return f"Instance {shown.iid} ({where}): {', '.join(sides) or 'not predicted'}."

    def height(self, scene: Scene, width: int) -> int:
        """The rows in which two images fill the width, with the numbers below."""
        dataset = scene.store.dataset
        share = dataset.frame_height / max(1, dataset.frame_width)
        kinds = 1 + any(domain.has_depth for domain in scene.store.domains.values())
        return kinds * math.ceil(width / 2 * share / 2) + _TEXT_ROWS

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        shown = scene.loaded.pictures
        if shown is None or scene.state.cursor is None:
            return Drawing()
        if remark := scene.remark(shown.iid):
            shown = replace(shown, notes=(("remark", remark), *shown.notes))
        return instance_drawing(shown, scene.state.images, scene.state.viewport_of(self.name))

    def zoom_plane(self, scene: Scene) -> ZoomPlane | None:
        shown = scene.loaded.pictures
        width, height = (1.0, 1.0) if shown is None else image_shape(shown)
        return ZoomPlane(self.name, Bounds(0.0, 0.0, width, height), True, inside=True)

    def drag(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> bool:
        """Move the divider between both sides, if there is one."""
        if scene.state.images.arrangement == "slide":
            share = (panel.to_cells(*point)[0] - panel.x) / panel.width
            session.dispatch(images.place_divider, share)
        return True

    def draw(self, scene: Scene, size: Size, options: RenderOptions) -> Canvas:
        return draw_cells(self.drawing(scene, size[0]), size, options)

    def heading(self, scene: Scene) -> tuple[str, str]:
        shown = scene.loaded.pictures
        if shown is None:
            return scene.title, ""
        split = dict(shown.notes).get("split", "")
        title = f"{scene.title}: instance {shown.iid}{f' ({split})' if split else ''}"
        return title, shown.heat_name and f"heat: {shown.heat_name}"

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        shown = scene.loaded.pictures
        if shown is None:
            raise RequestError("--select: selects nothing, so there is no instance to draw")
        if not any(side.rgb.size for _, side in shown.sides):
            reason = "this store has no frames to draw; `s2r show` prints the numbers"
            raise RequestError(f"--view instance: {reason}")
        return super().figure(scene, size, theme)


VIEW = InstanceView()
