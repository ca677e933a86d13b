"""Cache keys of the views: a view is redrawn if and only if something that it shows has changed."""

from collections.abc import Callable, Iterator
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from s2rstore.files.planned_poses import PlannedPose
from s2rstore.intervals import Interval
from s2rstore.language.syntax_tree import Everything, Nothing
from s2rstore.records import Bounds
from s2rtui.app.titled_view import TitledView
from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.canvas.marks import BrushShape
from s2rtui.charts.registry import VIEWS
from s2rtui.charts.scene import LoadedData, RunAccuracies, Scene, TranslatorRow
from s2rtui.charts.shared.instance_input import instance_input
from s2rtui.charts.view import View
from s2rtui.loaders import LoadContext, store_data
from s2rtui.session.provenance import (
    HeatProvenance,
    heat_provenance,
    instance_provenance,
    visible_floor_key,
)
from s2rtui.session.session import Session
from s2rtui.session.state import Adjust, Brush, HeatChoice, HistoryFile, Slider, State, Step, Target
from s2rtui.user_data.notebook import Notes, Remark
from tests.charts.examples import finding_report
from tests.support import gaps, tiny
from tests.support.drives import add_drives
from tests.support.suggestions import store_reports

SIZE = (80, 24)
SLIDER = Slider("real", "brightness", 0.5, 1.5, 1.0, 0.05, "")
ADJUST = Adjust("vanilla", ((SLIDER.key, 1.0),), 0, (SLIDER,))
BOX = ((2.0, 2.0), (6.0, 5.0))


def unselected(session: Session, state: State) -> np.ndarray:
    return state.base & ~state.selected


STATE_CHANGES: dict[str, Callable[[Session, State], object]] = {
    "generation": lambda _, state: state.generation + 1,
    "newest": lambda _, state: state.newest + 1,
    "runs": lambda _, state: state.runs[::-1],
    "run": lambda _, state: state.runs[1],
    "trajectories": lambda _, state: ("a",),
    "node": lambda _, state: Nothing(),
    "selected": unselected,
    "chosen": unselected,
    "unpaired": lambda _, state: state.base & (np.arange(state.base.size) % 3 > 0),
    "unpaired_text": lambda _, state: "3 sim only",
    "trained": lambda _, state: state.base & (np.arange(state.base.size) % 3 > 0),
    "with_trained": lambda _, state: not state.with_trained,
    "base": lambda _, state: state.base & (np.arange(state.base.size) % 3 > 0),
    "cursor": lambda _, state: (state.cursor or 0) + 1,
    "heat": lambda _, state: HeatChoice("occlusion", "rgb", "sim"),
    "operator": lambda _, state: "union",
    "brush": lambda _, state: Brush("map", BrushShape("map", BOX)),
    "lasso": lambda _, state: not state.lasso,
    "compared_run": lambda _, state: state.runs[-1],
    "pending": lambda _, state: Target(state.runs[1], state.generation),
    "adjust": lambda _, state: replace(ADJUST, values=((SLIDER.key, 1.2),)),
    "images": lambda _, state: replace(state.images, arrangement="slide", count=6),
    "map_mode": lambda _, state: "full",
    "map_value": lambda _, state: "gap",
    "overlay": lambda _, state: "run",
    "aggregate": lambda _, state: "max",
    "dims_unseen_floor": lambda _, state: not state.dims_unseen_floor,
    "room_names": lambda _, state: not state.room_names,
    "view": lambda _, state: "adjust",
    "centre": lambda _, state: "compare",
    "tab": lambda _, state: "rooms",
    "sort": lambda _, state: "iid",
    "descending": lambda _, state: not state.descending,
    "figure": lambda _, state: "n",
    "chosen_rows": lambda _, state: (
        ("rooms", "right"),
        ("findings", "1"),
        ("suggestions", "real 2"),
        ("objects", "chair"),
    ),
    "planned": lambda _, state: (POSE,),
    "planned_run": lambda _, state: "dataaug",
    "viewports": lambda _, state: (("map", Bounds(2.0, 2.0, 5.0, 4.0)),),
    "moment": lambda _, state: state.moment + 1.0,
    "fills_screen": lambda _, state: not state.fills_screen,
    "grouping": lambda _, state: "heading",
    "group_sort": lambda _, state: "n",
    "group_descending": lambda _, state: not state.group_descending,
    "history": lambda _, state: HistoryFile(Path("gap.jsonl"), (1, 2, 3)),
    "message": lambda _, state: "something",
    "is_error": lambda _, state: True,
    "keeps_message": lambda _, state: not state.keeps_message,
    "suggested": lambda _, state: Everything(),
    "past": lambda _, state: (Step(Everything()),),
    "future": lambda _, state: (Step(Everything()),),
}
RESOURCE_CHANGES: dict[str, Callable[[LoadedData], object]] = {
    "translators": lambda resources: (TranslatorRow("mkl", "real2sim", True),),
    "rows": lambda resources: (
        replace(resources.rows[0], real=Interval.unknown(0.3)),
        *resources.rows[1:],
    ),
    "lines": lambda resources: RunAccuracies(
        "sim", {r: v / 2 for r, v in resources.lines.values.items()}
    ),
    "baseline": lambda resources: 0.9,
    "floor_plan": lambda resources: np.full((20, 20, 3), 200, dtype=np.uint8),
    "pictures": lambda resources: replace(resources.pictures, iid=3, notes=(("where", "here"),)),
    "pictures_source": lambda resources: replace(resources.pictures_source, iid=3),
    "floor_heat": lambda resources: np.ones((4, 4), dtype=np.float32),
    "floor_heat_source": lambda resources: HeatProvenance(("another run's",), None),
    "seen_floor": lambda resources: np.eye(4, dtype=np.float32),
    "seen_floor_source": lambda resources: ("another run's",),
    "live": lambda resources: replace(resources.live, iid=5, notes=(("real", "else"),)),
    "live_source": lambda resources: replace(resources.live_source, run="another"),
    "live_floor_heat": lambda resources: np.ones((4, 4), dtype=np.float32),
    "history": lambda resources: gaps.history(*gaps.week()),
    "groups": lambda resources: None,
    "sheet": lambda resources: None,
    "cells": lambda resources: None,
    "findings": lambda resources: replace(resources.findings, findings=()),
    "models": lambda resources: {},
    "progress": lambda resources: {"live": 0.5},
    "failed": lambda resources: {"live": "no model"},
    "computation": lambda resources: "1 of 3",
    "computing": lambda resources: "computing vanilla: harm 1/2",
}
POSE = PlannedPose(1.0, 2.0, 30.0, "left", 0.5, "novelty")
NEVER_DRAWN = {
    "newest", "operator", "lasso", "message", "is_error", "past",
    "future", "centre", "progress", "computation", "pending", "keeps_message", "suggested",
}  # fmt: skip

IN_SCENE = {
    "sliding": ("adjust", "map", "instance"), "findings": ("findings",),
    "suggestions": ("suggestions",), "objects": ("objects",), "health": ("health",),
    "drives": ("drives",),
}  # fmt: skip
"""Views that differ from those of the plain scene; of the other scenes all views are compared."""


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    path = tiny.build(tmp_path_factory.mktemp("three") / "s.s2r", 16, ("vanilla", "b", "c"))
    store_reports(path, "vanilla", "real", "sim")
    add_drives(path)
    opened = Session(path)
    opened.select("worst(40%, real.error)")
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def scenes(session: Session) -> dict[str, Scene]:
    """A coloured map; a scene with heatmap, clipping, glyphs and a brush; a scene with sliders."""
    store, state = session.store, session.state
    grid = np.arange(16, dtype=np.float32).reshape(4, 4)
    loaded = store_data.read_rows(store, state, None) | store_data.read_lines(store, state, None)
    loaded |= store_data.read_groups(store, state, LoadContext())
    loaded["findings"] = finding_report()
    loaded |= store_data.read_cells(store, state, LoadContext())
    loaded |= store_data.read_sheet(store, state, LoadContext())
    pictures, live = (instance_input(store, state.run, i, state.heat) for i in (0, 2))
    sources = dict.fromkeys(("pictures_source", "live_source"), instance_provenance(state))
    plain = Scene(store, state, LoadedData(**loaded, pictures=pictures, live=live, **sources))
    rich = replace(
        state, overlay="selection", dims_unseen_floor=True, map_mode="glyph", room_names=True,
        sort="gap", brush=Brush("umap", BrushShape("real", BOX)),
        heat=HeatChoice("activation", "loss"), cursor=4,
    )  # fmt: skip
    heated = replace(
        plain.loaded, floor_heat=grid, seen_floor=grid > 7, live_floor_heat=grid[::-1],
        floor_heat_source=heat_provenance(rich), seen_floor_source=visible_floor_key(rich),
    )  # fmt: skip
    sliding = replace(state, view="adjust", tab="adjust", adjust=ADJUST, overlay="instance")
    rank = np.arange(state.base.size)
    return {
        "plain": plain,
        "rich": replace(plain, state=rich, loaded=heated),
        "sliding": replace(plain, state=sliding, loaded=heated),
        "findings": replace(plain, state=replace(state, view="findings")),
        "suggestions": replace(plain, state=replace(state, view="suggestions", planned=(POSE,))),
        "objects": replace(plain, state=replace(state, view="objects")),
        "health": replace(plain, state=replace(state, view="health")),
        "drives": replace(plain, state=replace(state, view="drives")),
        "trained": replace(
            plain, state=replace(state, with_trained=True, trained=state.base & (rank % 2 > 0))
        ),
    }


def draw(view: View, scene: Scene) -> tuple[Canvas, object]:
    drawing = TitledView(view, scene)
    return drawing.draw(SIZE, RenderOptions()), drawing.cache_key


def same_canvas(first: Canvas, second: Canvas) -> bool:
    return all(
        np.array_equal(getattr(first, part), getattr(second, part))
        for part in ("char", "fg", "bg", "bold")
    )


def changed_scenes(session: Session, scene: Scene) -> Iterator[tuple[str, Scene]]:
    for name, change in STATE_CHANGES.items():
        state = replace(scene.state, **{name: change(session, scene.state)})
        yield name, replace(scene, state=state)
    for name, change in RESOURCE_CHANGES.items():
        changed = replace(scene.loaded, **{name: change(scene.loaded)})
        yield name, replace(scene, loaded=changed)
    notes = Notes(remarks={int(np.flatnonzero(scene.state.selected)[0]): Remark(("odd",), "")})
    yield "notes", replace(scene, notes=notes)


def test_every_field_of_state_and_resources_is_covered():
    assert set(STATE_CHANGES) == {field.name for field in fields(State)}
    assert set(RESOURCE_CHANGES) == {field.name for field in fields(LoadedData)}


def test_a_changed_canvas_has_a_changed_cache_key(session, scenes):
    """And every field except the listed ones is drawn by some view of some scene."""
    drawn_fields = set()
    for scene_name, scene in scenes.items():
        views = [view for view in VIEWS if view.name in IN_SCENE.get(scene_name, (view.name,))]
        before = {view.name: draw(view, scene) for view in views}
        for name, changed in changed_scenes(session, scene):
            for view in views:
                canvas, key = before[view.name]
                has_changed_key = TitledView(view, changed).cache_key != key
                if has_changed_key and name in drawn_fields:
                    continue
                is_redrawn = not same_canvas(canvas, draw(view, changed)[0])
                assert has_changed_key or not is_redrawn, (scene_name, view.name, name)
                if is_redrawn:
                    drawn_fields.add(name)
    assert drawn_fields == {*STATE_CHANGES, *RESOURCE_CHANGES, "notes"} - NEVER_DRAWN


def test_only_what_a_view_shows_redraws_it(scenes):
    scene = scenes["rich"]
    message = replace(scene, state=replace(scene.state, message="else", past=(Step(Everything()),)))
    for view in VIEWS:
        key = TitledView(view, scene).cache_key
        assert key == TitledView(view, message).cache_key is not None, view.name
    moved = Brush("umap", BrushShape("real", ((1.0, 1.0), (3.0, 3.0))))
    changed = replace(scene, state=replace(scene.state, brush=moved))
    redrawn = {view.name for view in VIEWS if draw(view, changed)[1] != draw(view, scene)[1]}
    assert redrawn == {"umap"}


@pytest.mark.parametrize(
    ("name", "feed"),
    [
        ("history", "history"), ("map", "seen floor"), ("map", "floor plan"),
        ("map", "heat on the map"), ("overview", "rows"), ("instance", "pictures"),
    ],
)  # fmt: skip
def test_a_failed_load_is_not_shown_as_loading(session, name, feed):
    view = next(view for view in VIEWS if view.name == name)
    assert feed in view.loads
    state = replace(session.state, dims_unseen_floor=feed == "seen floor", cursor=4)
    failed = LoadedData(failed={feed: "no luck"})
    keys, texts = [], []
    for resources in (LoadedData(), failed):
        drawing = TitledView(view, Scene(session.store, state, resources))
        keys.append(drawing.cache_key)
        canvas = drawing.draw((160, 20), RenderOptions())
        texts.append("\n".join("".join(row) for row in canvas.char))
    assert keys[0] != keys[1]
    assert "no luck" not in texts[0]
    assert "no luck" in texts[1]
    assert "loading" not in texts[1]
    assert "reading" not in texts[1]
