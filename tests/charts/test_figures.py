"""Figures: exactly the size asked for, the same bytes, and something on them."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from s2rstore.errors import RequestError
from s2rtui.canvas import DARK, LIGHT, Theme
from s2rtui.charts.compare.paper import compare_figure
from s2rtui.charts.errors.paper import errors_figure
from s2rtui.charts.instance.paper import instance_figure
from s2rtui.charts.map.paper import map_figure
from s2rtui.charts.orientation.paper import orientation_figure
from s2rtui.charts.overview.paper import overview_figure
from s2rtui.charts.rooms.paper import rooms_figure
from s2rtui.charts.umap.paper import umap_figure
from tests.charts.examples import (
    ROWS,
    compare_input,
    errors_input,
    instance_input,
    map_input,
    orientation_input,
    overview_lines,
    rooms_input,
    side,
    umap_input,
)

Draw = Callable[[tuple[int, int], Theme], bytes]
FIGURES: dict[str, Draw] = {
    "overview": lambda size, theme: overview_figure(ROWS, 0.72, size, theme, selected=1),
    "overview lines": lambda size, theme: overview_figure(
        ROWS, 0.72, size, theme, lines=overview_lines()
    ),
    "map": lambda size, theme: map_figure(map_input(), size, theme, "vanilla", "worst15"),
    "full map": lambda size, theme: map_figure(map_input(mode="full"), size, theme),
    "glyph map": lambda size, theme: map_figure(
        map_input(mode="glyph", clip=np.eye(5)), size, theme
    ),
    "compare": lambda size, theme: compare_figure(
        (map_input(heat=None), map_input(heat=None)), compare_input(), size, theme
    ),
    "instance": lambda size, theme: instance_figure(instance_input(), size, theme, "vanilla"),
    "umap": lambda size, theme: umap_figure(umap_input(), size, theme),
    "orientation": lambda size, theme: orientation_figure(orientation_input(), size, theme),
    "rooms": lambda size, theme: rooms_figure(rooms_input(), size, theme),
    "errors": lambda size, theme: errors_figure(errors_input(cursor=5), size, theme),
}


def opened(data: bytes) -> Image.Image:
    return Image.open(BytesIO(data))


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("size", [(801, 603), (64, 48)])
def test_size_is_exact(name: str, size: tuple[int, int]) -> None:
    assert opened(FIGURES[name](size, LIGHT)).size == size


@pytest.mark.parametrize("name", FIGURES)
def test_bytes_repeat_and_carry_no_metadata(name: str) -> None:
    first, second = (FIGURES[name]((480, 360), DARK) for _ in range(2))
    assert first == second
    assert set(opened(first).info) <= {"dpi"}


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_ground_is_the_themes_and_all_colours_appear(theme: Theme) -> None:
    pixels = np.asarray(opened(FIGURES["overview"]((800, 500), theme)).convert("RGB"))
    assert tuple(pixels[0, 0]) == theme.background
    for colour in (theme.sim, theme.real, theme.truth):
        assert (np.abs(pixels.astype(int) - colour).max(axis=-1) <= 3).any()


def test_nothing_selected_and_nothing_known() -> None:
    nothing = np.zeros(60, dtype=np.bool_)
    view = map_input(selected=nothing, cursor=None, heat=None, floor_plan=None, rooms=())
    assert opened(map_figure(view, (300, 200))).size == (300, 200)
    bare = instance_input(sim=side(1, False, False), real=side(2, False, False), truth=None)
    assert opened(instance_figure(bare, (300, 200))).size == (300, 200)
    assert opened(overview_figure([], None, (300, 200))).size == (300, 200)
    assert opened(umap_figure(umap_input(selected=nothing), (300, 200))).size == (300, 200)
    none = np.full((60, 2), np.nan)
    unplaced = umap_input(sim=none, real=none, cursor=1)
    assert opened(umap_figure(unplaced, (300, 200))).size == (300, 200)
    turned = orientation_input(selected=nothing, valid=nothing)
    assert opened(orientation_figure(turned, (300, 200))).size == (300, 200)
    assert opened(rooms_figure(rooms_input(room_names=()), (300, 200))).size == (300, 200)
    errors = errors_input(selected=nothing, valid=nothing)
    assert opened(errors_figure(errors, (300, 200))).size == (300, 200)


def test_dollar_signs_are_text() -> None:
    map_figure(map_input(), (300, 200), title="a$b$c", subtitle="id$")


def test_impossible_size_is_refused_by_name() -> None:
    with pytest.raises(RequestError, match="--size"):
        overview_figure(ROWS, None, (0, 100))


@pytest.mark.parametrize("theme", [LIGHT, DARK])
@pytest.mark.parametrize("name", ["orientation", "rooms", "errors"])
def test_sides_keep_their_colours(name: str, theme: Theme) -> None:
    pixels = np.asarray(opened(FIGURES[name]((900, 500), theme)).convert("RGB")).astype(int)
    truth = [] if name == "errors" else [theme.truth]
    for colour in (theme.sim, theme.real, *truth):
        assert (np.abs(pixels - colour).max(axis=-1) <= 3).any()


def test_many_points_become_cells_of_the_same_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    few = umap_figure(umap_input(cursor=None), (600, 300))
    monkeypatch.setattr("s2rtui.charts.umap.paper.POINTS_UP_TO", 10)
    many = umap_figure(umap_input(cursor=None), (600, 300))
    assert few != many
    assert opened(many).size == (600, 300)
