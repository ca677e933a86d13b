"""Contrast of walls and points on drawn maps, in every theme and number of colours."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

import s2rstore
from bench.budget import BudgetRow
from bench.support.map_contrast import Ratios, measure
from s2rstore.records import Bounds
from s2rtui.canvas import THEMES, ColourMode, Pixels, RenderOptions
from s2rtui.canvas.colour import LEAST_CONTRAST, UNSELECTED_CONTRAST
from s2rtui.loaders.store_data import floor_plan_pixels

_PLAN_PIXELS = 1056
_REAL_BOUNDS = Bounds(-1.80, -1.26, 19.67, 20.08)
"""Metres that `map.jpg` of the Sim2RealViz data covers, as `s2r ingest sim2realviz` declares."""
_MODES = (ColourMode.TRUECOLOR, ColourMode.PALETTE, ColourMode.ANSI)


def figures(store: Path | None) -> Iterator[BudgetRow]:
    """The floor plan of `store`, or of the default world, and the real one if it is there."""
    yield from _of_plan("demo", *(_default_plan() if store is None else _plan_of(store)))
    data = os.environ.get("S2R_DATA")
    real = Path(data, "map.jpg") if data else None
    if real is None or not real.is_file():
        print("contrast: no real floor plan, S2R_DATA names no Sim2RealViz data", file=sys.stderr)
        return
    with Image.open(real) as picture:
        plan = np.asarray(picture.convert("RGB"))
    yield from _of_plan("real", plan, _REAL_BOUNDS)


def _default_plan() -> tuple[Pixels, Bounds]:
    from s2rtools.synthetic_world.floor_plan import BUILDING_SIZE
    from s2rtools.synthetic_world.world import World

    plan = World(1).renderer({}).plan(_PLAN_PIXELS)
    return plan, Bounds(0.0, 0.0, BUILDING_SIZE, BUILDING_SIZE)


def _plan_of(store: Path) -> tuple[Pixels, Bounds]:
    with s2rstore.open(store) as opened:
        return floor_plan_pixels(str(opened.floor_plan_path())), opened.dataset.bounds


def _of_plan(name: str, plan: Pixels, bounds: Bounds) -> Iterator[BudgetRow]:
    heat = np.add.outer(np.linspace(0, 1, 64), np.linspace(0, 1, 64)) / 2
    for theme in THEMES.values():
        for mode in _MODES:
            at = f"{name}, {theme.name}, {mode.value} colours"
            options = RenderOptions(theme, mode)
            plain = measure(plan, bounds, options)
            yield from _rows(f"{at}: wall to floor", plain.walls, LEAST_CONTRAST)
            yield from _rows(f"{at}: point to ground", plain.selected, LEAST_CONTRAST)
            yield from _rows(f"{at}: unselected to ground", plain.unselected, UNSELECTED_CONTRAST)
            heated = measure(plan, bounds, options, heat=heat)
            yield from _rows(f"{at}: point on heat", heated.selected, LEAST_CONTRAST)


def _rows(name: str, ratios: Ratios, budget: float) -> Iterator[BudgetRow]:
    yield BudgetRow(f"{name}, lowest", float(ratios.min()), "ratio", budget, "at least")
    yield BudgetRow(f"{name}, median", float(np.median(ratios)), "ratio", budget, "at least")
