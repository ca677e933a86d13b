"""Figures on narrow and wide pages of paper: texts apart and whole, units on every axis."""

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from s2rtui.canvas import LIGHT
from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.drawing import page as paper
from s2rtui.drawing.drawing import Drawing
from s2rtui.drawing.paper import draw_paper
from s2rtui.drawing.plot import Dots, Phrase, Plot, Points
from s2rtui.drawing.plot_paper import draw_plot
from s2rtui.drawing.scale import Scale
from s2rtui.export.figures import PageOptions, draw_figure
from s2rtui.export.load_scene import SceneOptions, open_scene
from tests.support import nights, tiny
from tests.support.copies import copy_store
from tests.support.drives import add_drives
from tests.support.suggestions import store_reports

NARROW = 80.0
WIDE = ("map with heat", "many: overview", "rooms")
"""Figures that are usually drawn on wide pages, too; the others by the deep tests."""
MANY = ("overview", "map", "umap", "orientation", "rooms", "errors", "compare", "scatter", "sheet")
"""Views that are drawn of many instances, too."""
DPI = 100
FIGURES: dict[str, tuple[str, dict[str, Any]]] = {
    view.name: (view.name, {"run": "vanilla", "select": "worst15"})
    for view in VIEWS
    if view.from_store
} | {
    "glyph map": ("map", {"map_mode": "glyph", "clip": True}),
    "full map": ("map", {"map_mode": "full", "room_names": True}),
    "map with heat": ("map", {"heat": "feature_distance", "overlay": "selection"}),
    "instance with heat": ("instance", {"heat": "occlusion:rgb"}),
    "list by gap": ("list", {"sort": "gap"}),
    "overview of all": ("overview", {}),
    "suggestions of one direction": ("suggestions", {"run": "dataaug"}),
    **{f"many: {view}": (view, {}) for view in MANY},
}
OWN_STORES = {"history": "with_nights", "suggestions": "with_suggestions", "drives": "with_drives"}
"""Fixture of the store from which a view is drawn where it is not the small one."""
UNITS = re.compile(r"\((m|m²|°|%|ms|s|loss|no unit)\)|instances|%|°|median error")


@pytest.fixture(scope="module")
def stores(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The small store, and one of 120 instances in four runs."""
    many = tmp_path_factory.mktemp("many") / "many.s2r"
    return tiny_store, tiny.build(many, 120, (*tiny.RUNS, "finetune", "perlin"))


@pytest.fixture(scope="module")
def with_nights(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the small store with a gap history of two nights."""
    folder = tmp_path_factory.mktemp("nights")
    own = copy_store(tiny_store, folder / "own.s2r")
    (folder / "drives").mkdir()
    week = nights.Week(nights.write_config(folder, own), {}, from_day=9)
    for night in (1, 2):
        week.night(night)
    return own


@pytest.fixture(scope="module")
def with_suggestions(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the small store with stored suggestions of both directions."""
    own = copy_store(tiny_store, tmp_path_factory.mktemp("suggestions") / "own.s2r")
    store_reports(own, "vanilla", "real", "sim")
    store_reports(own, "dataaug", "sim")
    return own


@pytest.fixture(scope="module")
def with_drives(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    own = copy_store(tiny_store, tmp_path_factory.mktemp("drives") / "own.s2r")
    add_drives(own)
    return own


PAGES = [
    pytest.param(name, width, id=f"{name}-{width:g}",
                 marks=() if width == NARROW or name in WIDE else pytest.mark.deep)
    for name, width in itertools.product(FIGURES, (NARROW, 160.0))
]  # fmt: skip


@pytest.fixture
def figure(
    name: str, width: float, stores: tuple[Path, Path], request: pytest.FixtureRequest,
    monkeypatch: pytest.MonkeyPatch,
) -> Figure:  # fmt: skip
    """The figure as it was before it was encoded; its page has the requested width."""
    figures: list[Figure] = []
    encoded = paper.Page.encoded

    def keep(page: paper.Page) -> bytes:
        figures.append(page.figure)
        return encoded(page)

    store = stores[name.startswith("many")]
    if of_view := OWN_STORES.get(FIGURES[name][0]):
        store = request.getfixturevalue(of_view)
    monkeypatch.setattr(paper.Page, "encoded", keep)
    pixels = int.from_bytes(draw(store, name, width)[16:20], "big")
    assert pixels == round(width / 25.4 * DPI)
    (drawn,) = figures
    return drawn


def draw(store: Path, name: str, width: float) -> bytes:
    view, options = FIGURES[name]
    with open_scene(store, SceneOptions(**options), BY_NAME[view]) as scene:
        return draw_figure(scene, BY_NAME[view], PageOptions(width=width, dpi=DPI))


def texts(figure: Figure) -> Iterator[tuple[str, Bbox]]:
    """Every visible text with its box in pixels; tick labels only within the axis."""
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    hidden: set[int] = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            shown = axis.get_visible() and axes.axison
            for tick in axis.get_major_ticks():
                inside = low - 1e-9 <= tick.get_loc() <= high + 1e-9
                if not (shown and inside):
                    hidden |= {id(tick.label1), id(tick.label2)}
            if not shown:
                hidden |= {id(axis.label), id(axis.offsetText)}
    for text in figure.findobj(Text):
        if text.get_visible() and text.get_text().strip() and id(text) not in hidden:
            box = text.get_window_extent(renderer)
            if box.width > 0 and box.height > 0:
                yield text.get_text(), box


@pytest.mark.parametrize(("name", "width"), PAGES)
def test_texts_are_whole_and_apart_and_axes_with_numbers_have_units(figure):
    wide, high = figure.bbox.size
    found = list(texts(figure))
    assert found
    limit = (wide + 1, high + 1)
    assert not [text for text, box in found if (box.p0 < -1).any() or (box.p1 > limit).any()]
    boxes = itertools.combinations(found, 2)
    assert not [(first, second) for (first, one), (second, two) in boxes if _shared(one, two)]
    assert not [text for text, _ in found if text.endswith("…")]
    for axes in figure.axes:
        for which in ("x", "y"):
            if _has_numbers(axes, which):
                label = _label(figure, axes, which)
                assert UNITS.search(label), (which, label)


def test_marks_at_the_edge_of_a_plot_are_whole():
    scale = Scale(0.0, 1.0, ("error (m)",))
    edge, held = np.array([0.0, 1.0]), np.ones(2, dtype=np.bool_)
    points = Points(edge, edge, np.ones(2, dtype=np.uint8), held, held, cursor=1)
    page = paper.new_page((600, 600), LIGHT, "", "")
    axes = page.axes(1.0, 1.0, 3.0, 3.0)
    draw_plot(axes, page, Plot(scale, scale, (points,)), (3.0, 3.0), True, True)
    assert len(axes.collections) == 3  # unselected, selected, and the ring
    assert not any(each.get_clip_on() for each in axes.collections)


def test_plots_of_the_smallest_weight_without_room_are_named(monkeypatch):
    figures: list[Figure] = []
    monkeypatch.setattr(paper.Page, "encoded", lambda page: figures.append(page.figure) or b"")
    x, y = Scale(0.0, 1.0, ("time (s)",)), Scale(0.0, 1.0, ("error (m)",))
    dots = (Dots(np.array([0.5]), np.array([0.5]), "sim"),)
    plots = tuple(
        Plot(x, y, dots, title=(Phrase(f"plot {at}"),), weight=float(at)) for at in range(9)
    )
    draw_paper(Drawing(plots), (600, 600), LIGHT)
    (drawn,) = figures
    shown = {text.strip() for text, _ in texts(drawn)}
    kept = {f"plot {at}" for at in range(9)} & shown
    assert "plot 8" in kept
    assert len(drawn.axes) == len(kept) < 9
    assert any(text.startswith("no room for plot 0, plot 1") for text in shown)
    assert min(axes.bbox.height for axes in drawn.axes) > 50


def _shared(one: Bbox, two: Bbox) -> bool:
    """Whether the boxes overlap by more than the empty margins of a line, 1.5 pixels."""
    wide = min(one.x1, two.x1) - max(one.x0, two.x0)
    high = min(one.y1, two.y1) - max(one.y0, two.y0)
    return bool(wide > 1.5 and high > 1.5)


def _has_numbers(axes: Axes, which: str) -> bool:
    if not axes.axison or axes.name == "polar":
        return False
    labels = (axes.get_xticklabels if which == "x" else axes.get_yticklabels)()
    return any(re.fullmatch(r"[≤≥]? ?[−-]?[\d.]+", label.get_text()) for label in labels)


def _label(figure: Figure, axes: Axes, which: str) -> str:
    """The label of an axis, of one beside it in the same row or column, or above a colour bar."""
    edge = "y0" if which == "x" else "x0"
    place = getattr(axes.get_position(), edge)
    same = [a for a in figure.axes if np.isclose(getattr(a.get_position(), edge), place)]
    names = [getattr(other, f"get_{which}label")() for other in [axes, *same]]
    if which == "y":
        names.append(axes.get_title(loc="left"))
        names += [text.get_text() for text in figure.texts if text.get_rotation() == 90]
    return " ".join(" ".join(names).split())
