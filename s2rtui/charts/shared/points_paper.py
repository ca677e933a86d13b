"""Points of instances on paper: unselected points, holes of trained ones, and grey cells."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rtui.analysis.binning import Bools, selection_indices
from s2rtui.drawing.page import Inks
from s2rtui.drawing.scale import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class MarkedInstances(Protocol):
    """The instances of a view: selected, valid (N,) bool; trained (N,) as in `ScatterInput`."""

    @property
    def selected(self) -> Bools: ...
    @property
    def valid(self) -> Bools: ...
    @property
    def trained(self) -> Bools | None: ...


@dataclass(frozen=True, slots=True, eq=False)
class PaperPoints:
    """Points of instances at `x`, `y` (N,) of some axes.

    members: iids of the selected valid instances. others: (N,) marks the other valid ones. holes:
    iids of the selected instances that the model was trained on.
    """

    axes: Axes
    inks: Inks
    x: Floats
    y: Floats
    members: NDArray[np.intp]
    others: Bools
    holes: NDArray[np.intp]

    def draw_unselected(self, size: float, order: int) -> None:
        """Draw the unselected points as grey dots of `size` square points."""
        x, y, ink = self.x[self.others], self.y[self.others], self.inks.unselected
        self.axes.scatter(x, y, s=size, color=ink, linewidths=0, zorder=order)

    def draw_holes(self, size: float, order: int) -> None:
        """Draw a hole of `size` square points into the marks of trained instances."""
        if not self.holes.size:
            return
        x, y, ink = self.x[self.holes], self.y[self.holes], [self.inks.background]
        self.axes.scatter(x, y, s=size, color=ink, linewidths=0, zorder=order)


def paper_points(
    axes: Axes, inks: Inks, x: Floats, y: Floats, instances: MarkedInstances
) -> PaperPoints:
    """The points of a view's instances at `x`, `y` (N,), by how they are drawn."""
    members = selection_indices(instances.selected, instances.valid).members
    others = np.asarray(instances.valid, dtype=np.bool_).copy()
    others[members] = False
    trained = instances.trained
    holes = members[:0] if trained is None else members[trained[members]]
    return PaperPoints(axes, inks, x, y, members, others, holes)


def cells_with_dots(dots: Bools) -> NDArray[np.bool_]:
    """(h, w) cells that hold one of the braille dots (4h, 2w)."""
    rows, columns = dots.shape
    return np.asarray(dots.reshape(rows // 4, 4, columns // 2, 2).any(axis=(1, 3)))
