"""Walls and points stand out on drawn maps, in every theme and number of colours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.support.map_contrast import measure
from s2rstore.records import Bounds
from s2rtools.synthetic_world.floor_plan import BUILDING_SIZE
from s2rtools.synthetic_world.world import World
from s2rtui.canvas import DARK, LIGHT, THEMES, ColourMode, RenderOptions, Theme, legible, turbo
from s2rtui.canvas.colour import (
    ANSI_16,
    contrast,
    glyph_ground,
    luminance,
    palette_256,
    to_16,
    to_256,
    with_luminance,
)
from s2rtui.charts.map.terminal import draw_map
from tests.charts.examples import map_input

COLOURED = (ColourMode.TRUECOLOR, ColourMode.PALETTE, ColourMode.ANSI)
BOUNDS = Bounds(0.0, 0.0, BUILDING_SIZE, BUILDING_SIZE)
TURBO = turbo(np.linspace(0, 1, 256))


@pytest.fixture(scope="module")
def demo_plan() -> np.ndarray:
    return World(1).renderer({}).plan(1056)


@pytest.mark.parametrize("theme", THEMES.values(), ids=lambda theme: theme.name)
@pytest.mark.parametrize("mode", COLOURED, ids=lambda mode: mode.value)
def test_walls_and_points_of_the_demo_stand_out(
    demo_plan: np.ndarray, theme: Theme, mode: ColourMode
) -> None:
    ratios = measure(demo_plan, BOUNDS, RenderOptions(theme, mode))
    assert len(ratios.walls) > 300
    assert len(ratios.selected) > 400
    assert ratios.walls.min() >= 3
    assert ratios.selected.min() >= 3
    assert ratios.unselected.min() >= 2.5


@pytest.mark.parametrize("theme", THEMES.values(), ids=lambda theme: theme.name)
@pytest.mark.parametrize("mode", COLOURED, ids=lambda mode: mode.value)
def test_points_stand_out_from_heat(demo_plan: np.ndarray, theme: Theme, mode: ColourMode) -> None:
    heat = np.add.outer(np.linspace(0, 1, 64), np.linspace(0, 1, 64))
    ratios = measure(demo_plan, BOUNDS, RenderOptions(theme, mode), heat=heat)
    assert ratios.selected.min() >= 3
    assert ratios.unselected.min() >= 2.5


def test_the_measure_finds_walls_that_are_hardly_visible(
    demo_plan: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    pale = replace(DARK, wall=(70, 74, 80))
    assert measure(demo_plan, BOUNDS, RenderOptions(pale)).walls.min() < 1.5


@pytest.mark.parametrize("symbols", ["half", "quadrant", "sextant", "octant"])
def test_symbols_change_neither_ascii_nor_colourless_maps(symbols: str) -> None:
    for options in (RenderOptions(ascii=True), RenderOptions(mode=ColourMode.NONE)):
        drawn = draw_map(map_input(), (80, 26), replace(options, symbols=symbols))
        usual = draw_map(map_input(), (80, 26), options)
        assert drawn.lines() == usual.lines()
        assert (drawn.fg == usual.fg).all()
    assert all(line.isascii() for line in draw_map(
        map_input(rooms=()), (80, 26), RenderOptions(ascii=True)).lines())  # fmt: skip


def test_contrast_is_that_of_wcag() -> None:
    assert contrast((0, 0, 0), (255, 255, 255)) == pytest.approx(21)
    assert contrast((119, 119, 119), (255, 255, 255)) == pytest.approx(4.48, abs=0.005)
    assert luminance((255, 0, 0)) == pytest.approx(0.2126, abs=1e-4)


@pytest.mark.parametrize("limits", [(0.3, 1.0), (0.0, 0.06), (0.1, 0.1)])
def test_colours_are_brought_between_luminances_and_keep_their_hue(
    limits: tuple[float, float],
) -> None:
    colours = np.random.default_rng(2).integers(0, 256, (500, 3)).astype(np.uint8)
    changed = with_luminance(colours, *limits)
    at = luminance(changed)
    assert (at >= limits[0] - 0.01).all()
    assert (at <= limits[1] + 0.01).all()
    hued = np.ptp(changed.astype(int), axis=1) > 40
    assert (colours.argmax(axis=1) == changed.argmax(axis=1))[hued].mean() > 0.97


@pytest.mark.parametrize("theme", THEMES.values(), ids=lambda theme: theme.name)
def test_texts_and_marks_are_legible_on_the_page(theme: Theme) -> None:
    for name in ("text", "muted", "sim", "real", "both", "truth", "cursor"):
        assert contrast(getattr(theme, name), theme.background) >= 4.5, name
    assert contrast(theme.unselected, theme.background) >= 2.5
    assert contrast(legible(TURBO, theme), theme.background).min() >= 3
    assert contrast(theme.wall, with_luminance(TURBO, *theme.floor)).min() >= 3


@pytest.mark.parametrize("theme", [DARK, LIGHT], ids=lambda theme: theme.name)
def test_marks_stay_legible_in_16_colours(theme: Theme) -> None:
    inks = ANSI_16[to_16(legible(TURBO, theme), theme.background)]
    assert contrast(inks, theme.background).min() >= 3
    assert len(np.unique(inks, axis=0)) >= 4


@pytest.mark.parametrize("theme", [DARK, LIGHT], ids=lambda theme: theme.name)
def test_marks_stay_legible_on_any_ground_in_256_colours(theme: Theme) -> None:
    random = np.random.default_rng(4)
    ground = random.integers(0, 256, (2000, 3)).astype(np.uint8)
    ink = legible(TURBO, theme)[random.integers(0, 256, 2000)]
    below = glyph_ground(ground, ink, theme, ColourMode.PALETTE)
    rounded = [palette_256()[to_256(colours) - 16] for colours in (ink, below)]
    assert contrast(*rounded).min() >= 2.9
