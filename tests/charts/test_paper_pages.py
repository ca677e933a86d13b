"""Figures on narrow and wide pages of paper: texts apart and whole, units on every axis."""

from __future__ import annotations

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

from s2rtui.charts.registry import BY_NAME, VIEWS
from s2rtui.charts.shared import paper
from s2rtui.export.figures import PageOptions, draw_figure
from s2rtui.export.load_scene import SceneOptions, open_scene
from tests.support import nights, tiny
from tests.support.copies import copy_store
from tests.support.suggestions import store_reports

WIDTHS = (80.0, 160.0)
MANY = ("overview", "map", "umap", "orientation", "rooms", "errors", "compare", "scatter")
"""Views that are drawn of many instances, too."""
DPI = 100
FIGURES: dict[str, tuple[str, dict[str, Any]]] = {
    view.name: (view.name, {"run": "vanilla", "select": "worst15"})
    for view in VIEWS
    if view.from_store
} | {
    "glyph map": ("map", {"map_mode": "glyph", "clip": True}),
    "full map": ("map", {"map_mode": "full", "room_names": True}),
    "map with heat": (
        "map",
        {"heat": "feature_distance", "overlay": "selection"},
    ),
    "instance with heat": ("instance", {"heat": "occlusion:rgb"}),
    "list by gap": ("list", {"sort": "gap"}),
    "overview of all": ("overview", {}),
    "suggestions of one direction": ("suggestions", {"run": "dataaug"}),
    **{f"many: {view}": (view, {}) for view in MANY},
}
UNITS = re.compile(r"\((m|m²|°|%|ms|loss|no unit)\)|instances|%|°|median error")


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are drawn, before they are encoded."""
    figures: list[Figure] = []
    encoded = paper.Page.encoded

    def keep(page: paper.Page) -> bytes:
        data = encoded(page)
        figures.append(page.figure)
        return data

    monkeypatch.setattr(paper.Page, "encoded", keep)
    return figures


@pytest.fixture(scope="module")
def stores(tiny_store: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """The small store, and one of 120 instances in four runs."""
    many = tmp_path_factory.mktemp("many") / "many.s2r"
    return tiny_store, tiny.build(many, 120, (*tiny.RUNS, "finetune", "perlin"))


def draw(store: Path, name: str, width: float, folder: Path) -> bytes:
    view, options = FIGURES[name]
    if view == "history":
        store = _with_nights(store, folder)
    if view == "suggestions":
        store = copy_store(store, folder / "own.s2r")
        store_reports(store, "vanilla", "real", "sim")
        store_reports(store, "dataaug", "sim")
    with open_scene(store, SceneOptions(**options), BY_NAME[view]) as scene:
        return draw_figure(scene, BY_NAME[view], PageOptions(width=width, dpi=DPI))


def _with_nights(store: Path, folder: Path) -> Path:
    """A copy of the store with a gap history of three nights."""
    own = copy_store(store, folder / "own.s2r")
    (folder / "drives").mkdir()
    week = nights.Week(nights.write_config(folder, own), {}, from_day=9)
    for night in (1, 2, 3):
        week.night(night)
    return own


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


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", FIGURES)
def test_texts_are_whole_and_apart(
    stores: tuple[Path, Path], tmp_path: Path, drawn: list[Figure], name: str, width: float
) -> None:
    draw(stores[name.startswith("many")], name, width, tmp_path)
    (figure,) = drawn
    wide, high = figure.bbox.size
    found = list(texts(figure))
    assert found
    outside = [
        text
        for text, box in found
        if box.x0 < -1 or box.y0 < -1 or box.x1 > wide + 1 or box.y1 > high + 1
    ]
    assert not outside
    overlapping = [
        (first, second)
        for (first, one), (second, two) in itertools.combinations(found, 2)
        if _shared(one, two)
    ]
    assert not overlapping
    assert not [text for text, _ in found if text.endswith("…")]


def _shared(one: Bbox, two: Bbox) -> bool:
    """Whether the boxes overlap by more than the empty margins of a line, 1.5 pixels."""
    wide = min(one.x1, two.x1) - max(one.x0, two.x0)
    high = min(one.y1, two.y1) - max(one.y0, two.y0)
    return bool(wide > 1.5 and high > 1.5)


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", FIGURES)
def test_axes_with_numbers_have_labels_with_units(
    stores: tuple[Path, Path], tmp_path: Path, drawn: list[Figure], name: str, width: float
) -> None:
    draw(stores[name.startswith("many")], name, width, tmp_path)
    (figure,) = drawn
    figure.draw_without_rendering()
    for axes in figure.axes:
        for which in ("x", "y"):
            if _has_numbers(axes, which):
                assert UNITS.search(_label(figure, axes, which)), (
                    which,
                    _label(figure, axes, which),
                )


def _has_numbers(axes: Axes, which: str) -> bool:
    if not axes.axison or axes.name == "polar":
        return False
    labels = (axes.get_xticklabels if which == "x" else axes.get_yticklabels)()
    return any(re.fullmatch(r"[≤≥]? ?[−-]?[\d.]+", label.get_text()) for label in labels)


def _label(figure: Figure, axes: Axes, which: str) -> str:
    """The label of an axis, of one beside it in the same row or column, or above a colour bar."""
    place = (
        (lambda other: other.get_position().y0)
        if which == "x"
        else (lambda other: other.get_position().x0)
    )
    same = [other for other in figure.axes if np.isclose(place(other), place(axes))]
    names = [getattr(other, f"get_{which}label")() for other in [axes, *same]]
    if which == "y":
        names.append(axes.get_title(loc="left"))
        names += [text.get_text() for text in figure.texts if text.get_rotation() == 90]
    return " ".join(" ".join(names).split())


@pytest.mark.parametrize("width", WIDTHS)
def test_pages_have_their_size_on_paper(tiny_store: Path, tmp_path: Path, width: float) -> None:
    data = draw(tiny_store, "map", width, tmp_path)
    (pixels,) = np.frombuffer(data[16:20], dtype=">u4")
    assert int(pixels) == round(width / 25.4 * DPI)
