"""A view: a function from a size to a canvas, repainted only where cells changed."""

from __future__ import annotations

from asyncio import TimerHandle
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from textual import events
from textual.geometry import Region
from textual.message import Message
from textual.strip import Strip
from textual.widget import Widget

from s2rtui.app.call_later import later
from s2rtui.canvas import Canvas, RenderOptions
from s2rtui.terminal.image_host import ImageHost
from s2rtui.terminal.strips import to_strips

Draw = Callable[[tuple[int, int], RenderOptions], Canvas]
Cell = tuple[int, int]

_GAP = 12
_REST = 0.15
"""Seconds without another size until pictures hang again."""


@dataclass(frozen=True, slots=True)
class Stroke:
    """Where the mouse went with its button down; `done` once it has let go."""

    view: str
    start: Cell
    trail: tuple[Cell, ...]
    done: bool


class Drag:
    """A stroke that grows; what is told of it waits for whoever takes it, and never queues up."""

    def __init__(self, view: str, start: Cell) -> None:
        self._view = view
        self._cells = [start]
        self._told = self._done = False

    @property
    def moved(self) -> bool:
        return len(self._cells) > 1

    def move(self, cell: Cell) -> bool:
        """Whether the cell is another one."""
        differs = self._cells[-1] != cell
        if differs:
            self._cells.append(cell)
        return differs

    def end(self) -> None:
        self._done = True

    def to_tell(self) -> bool:
        """Whether a message is due: none is on its way."""
        due, self._told = not self._told, True
        return due

    def taken(self) -> Stroke:
        self._told = False
        start, *trail = self._cells
        return Stroke(self._view, start, tuple(trail), self._done)


@dataclass(frozen=True, slots=True)
class Turn:
    """How far the wheel turned over a cell: above 0 away from the user, below towards."""

    view: str
    cell: Cell
    steps: int


class Wheel:
    """Turns of the wheel, summed up until somebody takes them; they never queue up."""

    def __init__(self, view: str) -> None:
        self._view = view
        self._cell = 0, 0
        self._steps = 0
        self._told = False

    def turn(self, cell: Cell, steps: int) -> bool:
        """Whether a message is due: none is on its way."""
        self._cell, self._steps = cell, self._steps + steps
        due, self._told = not self._told, True
        return due

    def taken(self) -> Turn:
        turn = Turn(self._view, self._cell, self._steps)
        self._steps, self._told = 0, False
        return turn


class PlotView(Widget, can_focus=False):
    """Draws what `show` was given; a new drawing sends only the cells that differ."""

    @dataclass
    class Pressed(Message):
        """The mouse went down and up again on a cell."""

        view: str
        cell: Cell

    class Dragged(Message):
        """The mouse moves with its button down, or has let go; one message for all moves since."""

        def __init__(self, drag: Drag) -> None:
            super().__init__()
            self._drag = drag

        def taken(self) -> Stroke:
            """The stroke as it is now. What comes after it is told by another message."""
            return self._drag.taken()

    class Wheeled(Message):
        """The wheel turns; one message for all its turns since."""

        def __init__(self, wheel: Wheel) -> None:
            super().__init__()
            self._wheel = wheel

        def taken(self) -> Turn:
            """All turns up to now. What comes after them is told by another message."""
            return self._wheel.taken()

    def __init__(
        self, name: str, look: RenderOptions, tolerance: int = 0, wall: ImageHost | None = None
    ) -> None:
        """`wall` draws its pictures; without one they are half blocks."""
        super().__init__(id=name)
        self.placed = False
        self._view = name
        self._look = look
        self._tolerance = tolerance
        self._draw: Draw | None = None
        self._depends: tuple[object, ...] | None = None
        self._canvas: Canvas | None = None
        self._strips: list[Strip] = []
        self._drag: Drag | None = None
        self._wheel = Wheel(name)
        self._wall = wall
        self._hangs: TimerHandle | None = None
        self._places: frozenset[tuple[Region, int]] = frozenset()

    def show(self, draw: Draw, depends: tuple[object, ...] | None = None) -> None:
        """Draw anew by `draw(size, look)`, unless `depends` is what it was."""
        unchanged = depends is not None and depends == self._depends
        self._draw, self._depends = draw, depends
        if not self.size.width or not self.size.height or (unchanged and self._canvas is not None):
            return
        before, places = self._canvas, self._places
        self._render_canvas()
        if self._wall is not None:
            self._hang_after(self._wall.rest(self._view))
        if before is None or self._canvas is None or before.char.shape != self._canvas.char.shape:
            self.refresh()
            return
        stay = [region for region, _ in places & self._places]
        regions = changed_regions(before, self._canvas, stay)
        if regions:
            self.refresh(*regions)

    def clear(self) -> None:
        """Hold nothing of what was drawn: not the store either that it was drawn from."""
        self._draw = self._depends = self._canvas = None
        self._strips = []
        self._places = frozenset()
        self._drop_hanging()

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
        if self._wall is not None:
            self._hang_after(_REST)

    def _hang_after(self, seconds: float) -> None:
        """Have the pictures drawn by the wall, at once or when nothing else comes for a while."""
        self._drop_hanging()
        if seconds:
            self._placed(frozenset())
            self._hangs = later(self, seconds, self.hang)
        else:
            self.hang()

    def _drop_hanging(self) -> None:
        if self._hangs is not None:
            self._hangs.cancel()
            self._hangs = None

    def hang(self) -> None:
        """Have the wall draw the pictures that are here."""
        if self._wall is not None and self._canvas is not None:
            hung = self._wall.hang(self._view, self._canvas, self._strips)
            self._strips = hung.strips
            self._placed(hung.places)

    def _placed(self, places: frozenset[tuple[Region, int]]) -> None:
        """Repaint where pictures came or went."""
        changed, self._places = places ^ self._places, places
        if changed:
            self.refresh(*(region for region, _ in changed))

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
        if self._drag is not None and self._drag.move((event.x, event.y)):
            self._tell(self._drag)

    def on_mouse_up(self, event: events.MouseUp) -> None:
        self.release_mouse()
        drag, self._drag = self._drag, None
        if drag is None:
            return
        drag.move((event.x, event.y))
        drag.end()
        if drag.moved:
            self._tell(drag)
        else:
            self.post_message(self.Pressed(self._view, drag.taken().start))

    @property
    def dragging(self) -> bool:
        """Whether the mouse's button is down here."""
        return self._drag is not None

    def abandon(self) -> bool:
        """Forget what the mouse has begun; True where there was something."""
        begun = self.dragging
        if begun:
            self.release_mouse()
            self._drag = None
        return begun

    def _tell(self, drag: Drag) -> None:
        if drag.to_tell():
            self.post_message(self.Dragged(drag))

    def on_mouse_scroll_up(self, event: events.MouseScrollUp) -> None:
        self._turn((event.x, event.y), 1)

    def on_mouse_scroll_down(self, event: events.MouseScrollDown) -> None:
        self._turn((event.x, event.y), -1)

    def _turn(self, cell: Cell, steps: int) -> None:
        if self._wheel.turn(cell, steps):
            self.post_message(self.Wheeled(self._wheel))


def changed_regions(before: Canvas, after: Canvas, stay: Sequence[Region] = ()) -> list[Region]:
    """Spans of cells that differ, one or several per row; near spans are joined.

    What differs under a picture of which all stays does not count.
    """
    differs = (before.char != after.char) | (before.bold != after.bold)
    differs |= (before.fg != after.fg).any(axis=-1) & (after.char != " ")
    differs |= (before.bg != after.bg).any(axis=-1)
    for region in stay:
        differs[region.y : region.bottom, region.x : region.right] = False
    regions: list[Region] = []
    for row in np.flatnonzero(differs.any(axis=1)):
        columns = np.flatnonzero(differs[row])
        cuts = np.flatnonzero(np.diff(columns) > _GAP) + 1
        regions += [
            Region(int(span[0]), int(row), int(span[-1] - span[0] + 1), 1)
            for span in np.split(columns, cuts)
        ]
    return regions
