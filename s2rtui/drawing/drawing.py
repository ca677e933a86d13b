"""A drawing as data: plots above each other, a table and notes.

A view makes it from its numbers; the renderers `cells` and `paper` draw it.
"""

from __future__ import annotations

from dataclasses import dataclass

from s2rtui.canvas import BrushShape
from s2rtui.drawing.heat_colours import RampName
from s2rtui.drawing.plot import Phrase, Plot
from s2rtui.drawing.table import TableSpec


@dataclass(frozen=True, slots=True)
class ColourBar:
    """The scale of the colours of points, of heat on a map, of changes or of images.

    clipped: whether values lie beyond its ends. ramp: the colours.
    """

    label: str
    unit: str
    scale: tuple[float, float]
    clipped: bool = False
    ramp: RampName = "values"


Note = str | tuple[Phrase | ColourBar, ...]
"""A line below a drawing: a text, or phrases and colour bars beside each other."""


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """What a view shows: plots above each other, a table and notes; each part may be absent.

    Neighbouring plots with the same scale of x share its axis. beside: whether plots stand beside
    each other where the drawing is wide. Plots of images are arranged by the room that they have;
    those with the same name of y are a row. thumbnails: whether the images are a sheet in which
    each stands below its title.
    """

    plots: tuple[Plot, ...] = ()
    table: TableSpec | None = None
    notes: tuple[Note, ...] = ()
    brush: BrushShape | None = None
    beside: bool = False
    thumbnails: bool = False

    @property
    def text(self) -> str:
        """The table and the notes in sentences, for screen readers."""
        rows = [] if self.table is None else list(self.table.sentences())
        notes = [note for note in self.notes if isinstance(note, str)]
        return ". ".join([*rows, *notes])
