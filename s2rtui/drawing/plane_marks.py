"""Marks of plots on a plane: a floor with heat, rooms, instances as signs, errors and poses.

Columns (N,) have one entry per instance and must not change in place: what is computed from them is
kept. `selected` and `valid` (N,) are the instances of which the marks show the selected valid ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds, Room
from s2rtui.analysis.binning import Bools
from s2rtui.drawing.scale import Floats, Range

if TYPE_CHECKING:
    from s2rtui.drawing.plot import Ink, Sign

Place = tuple[float, float, float | None]
"""A pose: x, y and the heading in radians, None where it is unknown."""
Columns = tuple[Floats, Floats]
"""x and y (N,)."""


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """A floor plan with heat; the floor that no instance has seen is dimmed.

    plan: (H, W, 3) uint8 over `bounds`, its first row drawn at the top. heat and seen:
    (rows, columns) over `bounds`, row 0 at bounds.y0; heat is NaN where there is none, and floor is
    unseen where `seen` is False, 0 or NaN. With `heat_is_signed` colours diverge from 0.
    """

    bounds: Bounds
    plan: NDArray[np.uint8] | None = None
    heat: Floats | None = None
    heat_is_signed: bool = False
    seen: Floats | Bools | None = None

    @property
    def is_plain(self) -> bool:
        """Whether there is nothing to draw, and so nothing that is dimmed."""
        return self.plan is None and self.heat is None


@dataclass(frozen=True, slots=True, eq=False)
class Outlines:
    """Outlines of rooms, each with its name where it covers the fewest marks."""

    rooms: tuple[Room, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Unselected:
    """The valid instances (N,) that are not selected, as small grey dots."""

    x: Floats
    y: Floats
    selected: Bools
    valid: Bools


@dataclass(frozen=True, slots=True, eq=False)
class Signs:
    """The selected instances (N,) as signs; cells with several show another one.

    values: (N,) of which a cell shows the largest by its colour on `scale`; None: all have `ink`.
    trained: instances that the model was trained on, None where none is shown.
    """

    x: Floats
    y: Floats
    selected: Bools
    valid: Bools
    sign: Sign = "selected"
    ink: Ink = "text"
    values: Floats | None = None
    scale: Range = (0.0, 1.0)
    trained: Bools | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Changes:
    """Changes `values` (N,) of the selected instances: triangles that point down below 0.

    Dots are changes within `margin`. Colours diverge from 0 to `scale` on both sides. A cell shows
    the mean of its instances. NaN is left out. texts: what changes below 0, within the margin and
    above 0 mean.
    """

    x: Floats
    y: Floats
    selected: Bools
    valid: Bools
    values: Floats
    margin: float
    scale: float
    texts: tuple[str, str, str]
    trained: Bools | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """Lines from `start` to `end` (N,) of the selected instances, while few of them are in view.

    cursor: an instance whose line is always drawn.
    """

    start: Columns
    end: Columns
    selected: Bools
    valid: Bools
    ink: Ink
    cursor: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Arcs:
    """Errors of both sides as arcs around the selected instances (N,), near ones in common.

    sim, real: errors along x and y (N,), NaN for none. full: the error of an arc of full width.
    """

    x: Floats
    y: Floats
    selected: Bools
    valid: Bools
    sim: Columns
    real: Columns
    full: float
    trained: Bools | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Poses as signs with an arrow in the direction of the heading, without a sign as arrows."""

    places: tuple[Place, ...]
    ink: Ink
    sign: Sign | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ScaleBar:
    """A bar of a round length in metres."""


PlaneMark = Floor | Outlines | Unselected | Signs | Changes | Segments | Arcs | Poses | ScaleBar
GROUND = (Floor, Outlines, ScaleBar, Unselected)
"""Marks that names of rooms may cover."""
