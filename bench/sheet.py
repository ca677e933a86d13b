"""Milliseconds to read and draw another page of the sheet, in half blocks and in true pixels."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from bench.budget import BudgetRow, seconds
from bench.measured_stores import Small, frames_store
from s2rtui.canvas import DEFAULT_OPTIONS, Canvas
from s2rtui.charts.sheet import VIEW
from s2rtui.export.load_scene import load_scene
from s2rtui.session import images
from s2rtui.session.session import Session
from s2rtui.terminal.graphics.reduced_png import png_within_limit, reduced_size

INSTANCES, FRAME = 10_000, 160
CELL = (10, 20)
"""Pixels of a cell, width and height."""
PAGES = ((12, (70, 37)), (24, (108, 56)))
"""Thumbnails of a page and cells of the sheet, on terminals of 120 x 40 and 200 x 60."""


def figures(folder: Path) -> Iterator[BudgetRow]:
    """Pages of a store of noise, which is built in `folder`."""
    session = Session(frames_store(folder / "sheet.s2r", INSTANCES, FRAME, Small()))
    try:
        for count, size in PAGES:
            while session.state.images.count != count:
                session.dispatch(images.change_count, 1)
            at = f"sheet, another page of {count} of {INSTANCES:,} in {size[0]}x{size[1]} cells: "
            taken = seconds(lambda size=size: _page(session, size), 9)
            yield BudgetRow(f"{at}half blocks", 1e3 * taken, "ms", 50)
            taken = seconds(lambda size=size: _pixels(_page(session, size)), 9)
            yield BudgetRow(f"{at}true pixels", 1e3 * taken, "ms", 150)
    finally:
        session.close()


def _page(session: Session, size: tuple[int, int]) -> Canvas:
    session.dispatch(images.turn_page, 1)
    return VIEW.draw(load_scene(session, VIEW), size, DEFAULT_OPTIONS)


def _pixels(canvas: Canvas) -> list[bytes]:
    return [png_within_limit(image, reduced_size(image, CELL)) for image in canvas.images]
