"""The widget of a view: draws a canvas and repaints only cells that changed."""

from __future__ import annotations

from asyncio import TimerHandle
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from textual import events
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.terminal.strips import ImageHost, ImagePlace, to_strips
from s2rtui.terminal.textual_compat import call_after

Cell = tuple[int, int]

_RESIZE_REST = 0.15
"""Seconds without a resize until inline images are sent again."""


class Drawable(Protocol):
    """Something that a plot widget draws."""

    @property
    def cache_key(self) -> tuple[object, ...] | None:
        """Key of everything the drawing depends on: equal keys draw once, None draws always."""

    def draw(self, size: tuple[int, int], options: RenderOptions) -> Canvas:
        """Draw in `size` (columns, rows)."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """The cells of a mouse drag; `done` once the button is released."""

    view: str
    start: Cell
    trail: tuple[Cell, ...]
    done: bool


class Drag:
    """A growing stroke; at most one message about it is in the queue."""

    def __init__(self, view: str, start: Cell) -> None:
        self._view = view
        self._cells = [start]
        self._is_posted = self._done = False

    @property
    def moved(self) -> bool:
        return len(self._cells) > 1

    def move(self, cell: Cell) -> bool:
        """Add a cell; whether it differs from the last one."""
        differs = self._cells[-1] != cell
        if differs:
            self._cells.append(cell)
        return differs

    def end(self) -> None:
        self._done = True

    def claim_message(self) -> bool:
        """Whether a message must be posted: none is in the queue."""
        due, self._is_posted = not self._is_posted, True
        return due

    def taken(self) -> Stroke:
        """Return the stroke so far; its message is handled, and a later move posts a new one."""
        self._is_posted = False
        start, *trail = self._cells
        return Stroke(self._view, start, tuple(trail), self._done)


class Wheel:
    """Wheel steps over the last cell, positive away from the user, negative towards.

    They are summed up so that at most one message is in the queue.
    """

    def __init__(self, view: str) -> None:
        self.view = view
        self.cell = 0, 0
        self._steps = 0
        self._is_posted = False

    def turn(self, cell: Cell, steps: int) -> bool:
        """Add steps; whether a message must be posted."""
        self.cell, self._steps = cell, self._steps + steps
        due, self._is_posted = not self._is_posted, True
        return due

    def take_steps(self) -> int:
        """All steps so far; later ones post another message."""
        steps, self._steps, self._is_posted = self._steps, 0, False
        return steps


class PlotView(Widget, can_focus=False):
    """Draws the argument of `show`; repaints only the cells that differ."""

    @dataclass
    class Pressed(Message):
        """A cell was clicked."""

        view: str
        cell: Cell

    @dataclass
    class Dragged(Message):
        """The mouse was dragged or released; one message for all moves since the last."""

        drag: Drag

    @dataclass
    class Hovered(Message):
        """The mouse moved over the widget or left it; `take_hover` returns its position."""

        plot: PlotView

    @dataclass
    class Wheeled(Message):
        """The wheel was turned; one message for all turns since the last."""

        wheel: Wheel

    def __init__(
        self,
        name: str,
        options: RenderOptions,
        tolerance: int = 0,
        image_host: ImageHost | None = None,
    ) -> None:
        """`image_host` shows inline images; without one they are drawn as half blocks."""
        super().__init__(id=name)
        self.placed = False
        self._view = name
        self._options = options
        self._tolerance = tolerance
        self._drawing: Drawable | None = None
        self._cache_key: tuple[object, ...] | None = None
        self._canvas: Canvas | None = None
        self._strips: list[Strip] = []
        self._drag: Drag | None = None
        self._wheel = Wheel(name)
        self._hover: Cell | None = None
        self._is_hover_posted = False
        self._image_host = image_host
        self._attach_timer: TimerHandle | None = None
        self._places: frozenset[ImagePlace] = frozenset()

    def show(self, drawing: Drawable) -> None:
        """Draw, unless the cache key equals the last one."""
        cache_key = drawing.cache_key
        unchanged = cache_key is not None and cache_key == self._cache_key
        self._drawing, self._cache_key = drawing, cache_key
        if not self.size.width or not self.size.height or (unchanged and self._canvas is not None):
            return
        before, places = self._canvas, self._places
        self._render_canvas()
        if self._image_host is not None:
            self._attach_after(self._image_host.debounce_seconds(self._view))
        if before is None or self._canvas is None or before.char.shape != self._canvas.char.shape:
            self.refresh()
            return
        regions = changed_regions(before, self._canvas, _same_places(places, self._places))
        if regions:
            self.refresh(*regions)

    def clear(self) -> None:
        """Release the drawing, and with it the store that it was drawn from."""
        self._drawing = self._cache_key = self._canvas = None
        self._strips = []
        self._places = frozenset()
        self._cancel_attach()

    def _render_canvas(self) -> None:
        if self._drawing is None:
            return
        size = self.size.width, self.size.height
        self._canvas = self._drawing.draw(size, self._options)
        self._strips = to_strips(
            self._canvas, self._options.mode, self._options.ascii, self._tolerance
        )

    def on_resize(self) -> None:
        self._canvas = None
        self._render_canvas()
        self.refresh()
        if self._image_host is not None:
            self._attach_after(_RESIZE_REST)

    def _attach_after(self, seconds: float) -> None:
        """Attach inline images, at once or when nothing else is drawn for some seconds."""
        self._cancel_attach()
        if seconds:
            self._set_image_places(frozenset())
            self._attach_timer = call_after(self, seconds, self.attach_images)
        else:
            self.attach_images()

    def _cancel_attach(self) -> None:
        if self._attach_timer is not None:
            self._attach_timer.cancel()
            self._attach_timer = None

    def attach_images(self) -> None:
        """Put inline images into the strips."""
        if self._image_host is not None and self._canvas is not None:
            painted = self._image_host.attach(self._view, self._canvas, self._strips)
            self._strips = painted.strips
            self._set_image_places(painted.places)

    def _set_image_places(self, places: frozenset[ImagePlace]) -> None:
        """Repaint where inline images appeared or disappeared, or must be drawn again."""
        changed = {place.region for place in places ^ self._places}
        for old, new in _same_places(self._places, places):
            if new.over_text and (old.text_cells & ~new.text_cells).any():
                changed.add(new.region)
        self._places = places
        if changed:
            self.refresh(*changed)

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

    # --- the mouse -----------------------------------------------------------------------------

    def on_mouse_down(self, event: events.MouseDown) -> None:
        self.capture_mouse()
        self._drag = Drag(self._view, (event.x, event.y))

    def on_mouse_move(self, event: events.MouseMove) -> None:
        if self._drag is None:
            self._set_hover((event.x, event.y))
        elif self._drag.move((event.x, event.y)):
            self._post_drag(self._drag)

    def on_leave(self) -> None:
        self._set_hover(None)

    def _set_hover(self, cell: Cell | None) -> None:
        """Post at most one message about all moves since the last."""
        if cell != self._hover:
            self._hover = cell
            if not self._is_hover_posted:
                self._is_hover_posted = True
                self.post_message(self.Hovered(self))

    def take_hover(self) -> tuple[str, Cell | None]:
        """The view and the cell under the mouse, None outside; a later move posts again."""
        self._is_hover_posted = False
        return self._view, self._hover

    def on_mouse_up(self, event: events.MouseUp) -> None:
        self.release_mouse()
        drag, self._drag = self._drag, None
        if drag is None:
            return
        drag.move((event.x, event.y))
        drag.end()
        if drag.moved:
            self._post_drag(drag)
        else:
            self.post_message(self.Pressed(self._view, drag.taken().start))

    @property
    def dragging(self) -> bool:
        """Whether the mouse button is held down in this widget."""
        return self._drag is not None

    def abandon(self) -> bool:
        """Drop an unfinished drag; whether there was one."""
        was_dragging = self.dragging
        if was_dragging:
            self.release_mouse()
            self._drag = None
        return was_dragging

    def _post_drag(self, drag: Drag) -> None:
        if drag.claim_message():
            self.post_message(self.Dragged(drag))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        self._turn(event, 1)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        self._turn(event, -1)

    def _turn(self, event: events.MouseEvent, steps: int) -> None:
        if self._wheel.turn((event.x, event.y), steps):
            self.post_message(self.Wheeled(self._wheel))


def _same_places(
    before: frozenset[ImagePlace], after: frozenset[ImagePlace]
) -> list[tuple[ImagePlace, ImagePlace]]:
    """The inline images that stay where they are, with their text before and after."""
    old = {place: place for place in before}
    return [(old[place], place) for place in after if place in old]


def changed_regions(
    before: Canvas, after: Canvas, stay: Sequence[tuple[ImagePlace, ImagePlace]] = ()
) -> list[Region]:
    """The changed cells as one region per row, because Textual redraws a row from its start.

    Changes under an inline image that stays (`stay`) are ignored, except changes of text on it. An
    image that lies on its cells is drawn again with the start of its first row.
    """
    differs = (before.char != after.char) | (before.bold != after.bold)
    differs |= (before.fg != after.fg).any(axis=-1) & (after.char != " ")
    differs |= (before.bg != after.bg).any(axis=-1)
    for old, new in stay:
        region = new.region
        differs[region.y : region.bottom, region.x : region.right] &= (
            old.text_cells | new.text_cells
        )
    regions: list[Region] = []
    for row in np.flatnonzero(differs.any(axis=1)):
        columns = np.flatnonzero(differs[row])
        first, last = int(columns[0]), int(columns[-1])
        regions.append(Region(first, int(row), last - first + 1, 1))
    for _, new in stay:
        anchor = new.region.offset
        if new.over_text and any(region.contains_point(anchor) for region in regions):
            regions.append(new.region)
    return regions
