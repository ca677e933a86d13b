"""The sheet view: the selected instances as thumbnails, sorted by any column of the list."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import NotComputedError
from s2rstore.language import fields
from s2rstore.reader import Store
from s2rstore.records import SIDES, Side
from s2rtui.canvas import PlotArea, Point
from s2rtui.charts.scene import LoadedSheet, Scene
from s2rtui.charts.shared.instance import common_scale, overlay_ramp
from s2rtui.charts.shared.list_columns import list_column
from s2rtui.charts.view import Pane, Table, View
from s2rtui.drawing.drawing import ColourBar, Drawing
from s2rtui.drawing.image import Image, ImageValues
from s2rtui.drawing.plot import Phrase, Plot
from s2rtui.drawing.scale import Floats, Scale
from s2rtui.session import images, instance_list
from s2rtui.session.heatmaps import SIGNED, run_range, unit
from s2rtui.session.model_input import model_input, stored_image
from s2rtui.session.session import Session
from s2rtui.session.state import HeatChoice, State

Pixels = NDArray[np.uint8]


def sheet_page(store: Store, state: State) -> LoadedSheet:
    """The thumbnails of the page that a state shows; reads frames and heatmaps."""
    iids, picture = images.page(store, state).tolist(), images.shown_picture(state)
    source = images.page_key(store, state)
    if picture == "difference":
        both = ((iid, *(_pixels(store, state, side, iid) for side in SIDES)) for iid in iids)
        return LoadedSheet(source, {iid: Image(_difference(*sides), None, "no pair")
                                    for iid, *sides in both})  # fmt: skip
    side = state.side if picture == "heat" else picture
    grounds = {iid: _pixels(store, state, side, iid) for iid in iids}
    heat = state.shown_heat if picture == "heat" else None
    heats = {} if heat is None else _heats(store, state.run, heat, iids)
    bar = None
    if heat is not None:
        signed, run_wide = heat.kind in SIGNED, run_range(store, state.run, heat)
        if (scale := common_scale(list(heats.values()), signed, run_wide)) is not None:
            values = unit(store, state.run, heat), scale, run_wide is not None
            bar = ColourBar(heat.label, *values, overlay_ramp(signed))
    shown = {}
    for iid, pixels in grounds.items():
        over = None
        if bar is not None and iid in heats:
            over = ImageValues(heats[iid], bar.scale, bar.ramp, "heat")
        shown[iid] = Image(pixels if pixels.size else None, over, "no image")
    return LoadedSheet(source, shown, bar)


def _heats(store: Store, run: str, heat: HeatChoice, iids: Sequence[int]) -> dict[int, Floats]:
    """The heatmaps that are computed, by iid."""
    found: dict[int, Floats] = {}
    for iid in iids:
        with suppress(NotComputedError):
            found[iid] = store.heatmap(run, heat.kind, heat.side, iid, heat.mode)
    return found


def _pixels(store: Store, state: State, side: Side, iid: int) -> Pixels:
    """The image (H, W, 3) that the run's model received; of size 0 without one."""
    if not store.has_poses:
        return stored_image(store, side, iid).rgb
    return model_input(store, store.displayed_run(state.run), side, iid).rgb


def _difference(sim: Pixels, real: Pixels) -> Pixels | None:
    """The absolute difference of each pixel; None without a pair."""
    if not sim.size or sim.shape != real.shape:
        return None
    return np.abs(real.astype(np.int16) - sim).astype(np.uint8)


class SheetView(View):
    name = "sheet"
    key = "_"
    pane: Pane = "centre"
    description = "the selection as thumbnails: real, sim, difference or heat"
    loads = ("sheet",)
    brushable = False
    needs_poses = False
    needs_run = False
    figure_size = (1600, 1200)

    def subtitle(self, scene: Scene) -> str:
        state, iids = scene.state, self.input(scene)
        pages = max(1, math.ceil(iids.size / state.images.count))
        page = images.page_number(iids, state) + 1
        order = fields.with_unit(_sort(state))
        picture = images.shown_picture(state)
        return f"{picture}, {state.count_text} by {order}, page {page} of {pages}"

    def input(self, scene: Scene) -> NDArray[np.intp]:
        """The iids of the selected instances (n,) in their order."""
        return images.sheet_order(scene.store, scene.state)

    def missing(self, scene: Scene) -> tuple[str, ...]:
        return () if self.input(scene).size else ("nothing is selected",)

    def cache_key(self, scene: Scene) -> tuple[object, ...]:
        state, page = scene.state, images.page_key(scene.store, scene.state)
        loaded = scene.loaded.sheet
        return *super().cache_key(scene), page, state.sort, state.images.count, loaded

    def drawing(self, scene: Scene, columns: int) -> Drawing:
        state, loaded = scene.state, scene.loaded.sheet
        kind = images.page_key(scene.store, state)[:4]
        is_shown = loaded is not None and loaded.source[:4] == kind
        known = loaded.images if loaded is not None and is_shown else {}
        dataset, text = scene.store.dataset, list_column(scene, _sort(state)).text
        x = Scale(0.0, dataset.frame_width / max(1, dataset.frame_height))
        plots = []
        for iid in images.page(scene.store, state).tolist():
            label = f"{iid}" if _sort(state) == "iid" else f"{iid}  {text(iid)}"
            title = Phrase(label, "text")
            if iid == state.cursor:
                title = Phrase(label, "cursor", "cursor")
            image = known.get(iid, Image(None, missing="loading"))
            plots.append(Plot(x, Scale(1.0, 0.0), (image,), str(iid), (title,)))
        bar = loaded.bar if loaded is not None and is_shown else None
        return Drawing(tuple(plots), notes=((bar,),) if bar else (), thumbnails=True)

    def numbers(self, scene: Scene) -> Table:
        names = dict.fromkeys(("iid", _sort(scene.state)))
        columns = [list_column(scene, name) for name in names]
        page = images.page(scene.store, scene.state).tolist()
        return (
            [fields.column_of(column.name) for column in columns],
            [[column.value(iid) for column in columns] for iid in page],
        )

    def summary(self, scene: Scene) -> str:
        _, rows = self.numbers(scene)
        listed = ", ".join(str(row[0]) for row in rows)
        return f"{sentence_of(scene)}: {listed or 'none'}."

    def heading(self, scene: Scene) -> tuple[str, str]:
        return f"{scene.title}: {sentence_of(scene)}", scene.caption

    def click(self, session: Session, scene: Scene, panel: PlotArea, point: Point) -> None:
        session.set_cursor(int(panel.name))

    def instance_at(self, scene: Scene, panel: PlotArea, cell: Point) -> int | None:
        return int(panel.name)


def sentence_of(scene: Scene) -> str:
    """What the thumbnails show, and their order."""
    return f"{images.shown_picture(scene.state)} images by {fields.with_unit(_sort(scene.state))}"


def _sort(state: State) -> str:
    """The column that sorts: that of the list, but the number of the instance for remarks."""
    return "iid" if state.sort == instance_list.REMARK else state.sort


VIEW = SheetView()
