"""What a view is: numbers from the scene, a drawing of them, and what a brush on it means."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

from s2rtui.canvas import Canvas, RenderOptions, Size, Theme
from s2rtui.canvas.brush import Mark, Panel, Point
from s2rtui.charts.scene import Scene
from s2rtui.session import Session

Pane = Literal["overview", "centre", "tab"]
Table = tuple[Sequence[str], Sequence[Sequence[object]]]
Pixels = tuple[int, int]


class View:
    """One view; a subclass says what it tells, draws and means.

    `name` is its word, `key` the key that shows it. `pane` is its place: the overview's, the
    large centre, or one that it shares with others where the screen is small. `aliases` are other
    words for it on the command line. `feeds` names what it needs from workers. `stored` tells that
    a store holds all that it shows, `one` that it shows one instance, `marked` that marks on its
    panels mean expressions; `paper` is the size of its figure where none is asked for.
    """

    name: str
    key: str
    pane: Pane = "tab"
    description: str
    aliases: tuple[str, ...] = ()
    feeds: tuple[str, ...] = ()
    stored: bool = True
    one: bool = False
    marked: bool = True
    paper: Pixels = (1600, 900)

    def told(self, scene: Scene) -> str:
        """The words beside the title."""
        return ""

    def depends(self, scene: Scene) -> tuple[object, ...] | None:
        """What the drawing depends on; equal means unchanged, None that it is always drawn."""
        return None

    def draw(self, scene: Scene, size: Size, look: RenderOptions) -> Canvas:
        """The view in `size` (columns, rows)."""
        raise NotImplementedError

    def height(self, scene: Scene, width: int) -> int:
        """The rows that the view would like; 0 takes what there is."""
        return 0

    def surface(self, scene: Scene, size: Size, look: RenderOptions) -> Sequence[Panel]:
        """Where it can be brushed, or takes the mouse otherwise."""
        return ()

    def at(self, scene: Scene, panel: Panel) -> Point | None:
        """Where a brush by keys begins: the cursor's place in a panel."""
        return None

    def press(self, session: Session, scene: Scene, panel: Panel, point: Point) -> None:
        """What a click on a panel does, at a point in data."""

    def drag(self, session: Session, scene: Scene, panel: Panel, point: Point) -> bool:
        """What dragging to a point in data does; False where it draws a mark."""
        return False

    def numbers(self, scene: Scene) -> Table:
        """What it shows as a flat table: names of columns, and rows; NaN or None for nothing."""
        raise NotImplementedError

    def words(self, scene: Scene) -> str:
        """What it shows in a sentence or two, with the numbers that matter most."""
        raise NotImplementedError

    def figure(self, scene: Scene, size: Pixels, theme: Theme) -> bytes:
        """The view drawn for paper. Raises RequestError where there is nothing to draw."""
        raise NotImplementedError

    def meaning(self, scene: Scene, panel: Panel, mark: Mark) -> str:
        """The expression that a mark stands for."""
        raise NotImplementedError
