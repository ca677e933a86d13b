"""Map and images in true pixels: milliseconds to draw and encode, and bytes on the wire."""

from __future__ import annotations

from base64 import standard_b64encode
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import s2rstore
from bench.budget import BudgetRow, seconds
from s2rstore.records import Bounds
from s2rtui.canvas import DEFAULT_OPTIONS, InlineImage, Pixels
from s2rtui.charts.map import MapInput, map_drawing
from s2rtui.drawing.cells import draw_cells
from s2rtui.drawing.plane_marks import Floor
from s2rtui.loaders.store_data import floor_plan_pixels
from s2rtui.terminal.graphics.drawn_images import inline_file
from s2rtui.terminal.graphics.reduced_png import MAX_DRAWN_BYTES, png_within_limit, reduced_size
from s2rtui.terminal.graphics.sixel import quantised, sixels

CELL = (10, 20)
"""Pixels of a cell, width and height."""
SIZES = ((70, 37), (108, 56))
"""Cells of the map on terminals of 120 x 40 and 200 x 60."""
INSTANCES = 500
MANY = 1_000_000


def figures(store: Path) -> Iterator[BudgetRow]:
    """The map on the store's floor plan, with few and with a million instances."""
    plan, bounds = _plan(store)
    for size in SIZES:
        at = f"true pixels, map in {size[0]}x{size[1]} cells: "
        image = _image(_points(plan, bounds, INSTANCES), size)
        yield from _protocols(image, at)
    crowd = _image(_points(plan, bounds, MANY), SIZES[0])
    shape = crowd.height * CELL[1], crowd.width * CELL[0]
    taken = seconds(lambda: crowd.pixels(shape), 3)
    yield BudgetRow("true pixels, a million instances drawn", 1e3 * taken, "ms")


def _protocols(image: InlineImage, at: str) -> Iterator[BudgetRow]:
    size = image.height * CELL[1], image.width * CELL[0]
    picture = image.pixels(size)
    yield BudgetRow(f"{at}drawn", 1e3 * seconds(lambda: image.pixels(size), 3), "ms")
    reduced = quantised(picture)
    error = np.abs(reduced.pixels.astype(np.int16) - picture)
    yield BudgetRow(f"{at}sixel, mean error of a channel", float(error.mean()), "of 255", 4)
    written = sixels(reduced)
    taken = seconds(lambda: sixels(quantised(picture)), 3)
    yield BudgetRow(f"{at}sixel, encoded", 1e3 * taken, "ms")
    yield BudgetRow(f"{at}sixel", len(written), "bytes")
    small = reduced_size(image, CELL)
    content = png_within_limit(image, small)
    taken = seconds(lambda: png_within_limit(image, small), 3)
    yield BudgetRow(f"{at}PNG, drawn and encoded", 1e3 * taken, "ms")
    yield BudgetRow(f"{at}kitty", len(standard_b64encode(content)), "bytes", MAX_DRAWN_BYTES * 1.4)
    sent = inline_file(content, (image.width, image.height))
    yield BudgetRow(f"{at}iTerm2", len(sent), "bytes", MAX_DRAWN_BYTES * 1.4)


def _plan(store: Path) -> tuple[Pixels, Bounds]:
    with s2rstore.open(store) as opened:
        return floor_plan_pixels(str(opened.floor_plan_path())), opened.dataset.bounds


def _points(plan: Pixels, bounds: Bounds, count: int) -> MapInput:
    """`count` instances at random positions, half of them selected, with random values."""
    rng = np.random.default_rng(1)
    low, high = (bounds.x0, bounds.y0), (bounds.x1, bounds.y1)
    x, y = rng.uniform(low, high, (count, 2)).T.copy()
    selected, valid = rng.random(count) < 0.5, np.ones(count, dtype=np.bool_)
    values = rng.gamma(2.0, 1.0, count)
    floor = Floor(bounds, plan)
    return MapInput(*((x, y) for _ in range(5)), values, selected, valid, floor, cursor=3)


def _image(data: MapInput, size: tuple[int, int]) -> InlineImage:
    (image,) = draw_cells(map_drawing(data), size, DEFAULT_OPTIONS).images
    return image
