"""A view: a function from a size to a canvas, repainted only where cells changed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from textual.geometry import Region, Size
from textual.strip import Strip
from textual.widget import Widget

from s2rtui.canvas import Canvas, Look, to_strips

Draw = Callable[[tuple[int, int], Look], Canvas]

_GAP = 12


class PlotView(Widget, can_focus=False):
    """Draws what `show` was given; a new drawing sends only the cells that differ."""

    def __init__(self, name: str, look: Look, tolerance: int = 0, rows: int = 0) -> None:
        """`rows` is the height that the plot would like; 0 takes what there is."""
        super().__init__(id=name)
        self.rows = rows
        self._look = look
        self._tolerance = tolerance
        self._draw: Draw | None = None
        self._canvas: Canvas | None = None
        self._strips: list[Strip] = []

    def show(self, draw: Draw) -> None:
        """Draw anew by `draw(size, look)`."""
        self._draw = draw
        if not self.size.width or not self.size.height:
            return
        before = self._canvas
        self._render_canvas()
        if before is None or self._canvas is None or before.char.shape != self._canvas.char.shape:
            self.refresh()
            return
        regions = changed_regions(before, self._canvas)
        if regions:
            self.refresh(*regions)

    def _render_canvas(self) -> None:
        if self._draw is None:
            return
        size = self.size.width, self.size.height
        self._canvas = self._draw(size, self._look)
        self._strips = to_strips(self._canvas, self._look.mode, self._look.ascii, self._tolerance)

    def on_resize(self) -> None:
        self._canvas = None
        self._render_canvas()
        self.refresh()

    def get_content_height(self, container: Size, viewport: Size, width: int) -> int:
        return self.rows or container.height

    def render_lines(self, crop: Region) -> list[Strip]:
        """The strips of a part of the widget."""
        if self._canvas is None or (self._canvas.width, self._canvas.height) != self.size:
            self._render_canvas()
        if self._canvas is None:
            return [Strip.blank(crop.width) for _ in range(crop.height)]
        blank = Strip.blank(self.size.width)
        lines = [
            self._strips[y] if y < len(self._strips) else blank for y in range(crop.y, crop.bottom)
        ]
        if crop.x == 0 and crop.width == self.size.width:
            return lines
        return [line.crop(crop.x, crop.right) for line in lines]


def changed_regions(before: Canvas, after: Canvas) -> list[Region]:
    """Spans of cells that differ, one or several per row; near spans are joined."""
    differs = (before.char != after.char) | (before.bold != after.bold)
    differs |= (before.fg != after.fg).any(axis=-1) & (after.char != " ")
    differs |= (before.bg != after.bg).any(axis=-1)
    regions: list[Region] = []
    for row in np.flatnonzero(differs.any(axis=1)):
        columns = np.flatnonzero(differs[row])
        cuts = np.flatnonzero(np.diff(columns) > _GAP) + 1
        regions += [
            Region(int(span[0]), int(row), int(span[-1] - span[0] + 1), 1)
            for span in np.split(columns, cuts)
        ]
    return regions
