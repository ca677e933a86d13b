"""Radial bars in braille dots: which dot belongs to which bin, and how far out it lies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from s2rtui.canvas.brush import Point

Dots = NDArray[np.bool_]
RING = 0.32
"""Radius of the ring as a share of the rim's."""


@dataclass(frozen=True, slots=True)
class Dial:
    """A disc in cells: centre, and radii of ring and rim in columns (a row is two columns high).

    Headings in degrees run from the right, downwards if `y_down`.
    """

    x: float
    y: float
    ring: float
    rim: float
    y_down: bool

    def to_data(self, column: float, row: float) -> Point:
        """(degrees in [-180, 180), radius: 0 at the ring, 1 at the rim) of a place in cells."""
        across, down = column - self.x, 2 * (row - self.y)
        turn = float(np.degrees(np.arctan2(down if self.y_down else -down, across)))
        distance = float(np.hypot(across, down))
        return (turn if turn < 180 else -180.0), (distance - self.ring) / (self.rim - self.ring)

    def to_cells(self, degrees: float, radius: float) -> Point:
        """The place in cells; the inverse of `to_data`."""
        distance = self.ring + radius * (self.rim - self.ring)
        turn = np.radians(degrees)
        down = distance * np.sin(turn) * (1 if self.y_down else -1)
        return float(self.x + distance * np.cos(turn)), float(self.y + down / 2)


def dial_of(x: float, y: float, width: int, height: int, y_down: bool, margin: Point) -> Dial:
    """The largest disc in a rectangle of cells, `margin` columns and rows from its edges."""
    rim = max(1.0, min(width / 2 - margin[0], height - 2 * margin[1]))
    return Dial(x + width / 2, y + height / 2, RING * rim, rim, y_down)


def ring_dots(dial: Dial, width: int, height: int) -> Dots:
    """(4 height, 2 width) braille dots: the circle that the bars stand on."""
    distance = 2 * _polar(dial, width, height, 4, 1)[1]
    return np.abs(distance - 2 * dial.ring) < 0.5


def bar_dots(dial: Dial, width: int, height: int, lengths: ArrayLike, fine: int = 4) -> Dots:
    """(fine height, 2 width) dots: bars of `lengths` 0 .. 1, one per bin, from -180 degrees on."""
    lengths = np.clip(lengths, 0.0, 1.0)
    bin_of, share, rays, along = _bars(dial, width, height, fine, len(lengths))
    dots = (share > 0) & (share <= lengths[bin_of])
    reached = (lengths[:, None] > 0) & (along[None] <= np.maximum(lengths, along[0])[:, None])
    dots.flat[rays[reached & (rays >= 0)]] = True
    return np.asarray(dots)


@lru_cache(32)
def _polar(
    dial: Dial, width: int, height: int, fine: int, count: int
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Bin and distance from the centre (columns) of every dot of `width` x `height` cells."""
    across = (np.arange(2 * width) + 0.5) / 2 - dial.x
    down = ((np.arange(fine * height) + 0.5) / fine - dial.y) * 2
    turn = np.arctan2((down if dial.y_down else -down)[:, None], across[None, :])
    bin_of = np.floor((turn + np.pi) / (2 * np.pi) * count).astype(np.intp) % count
    return bin_of, np.hypot(down[:, None], across[None, :])


@lru_cache(32)
def _bars(
    dial: Dial, width: int, height: int, fine: int, count: int
) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.intp], NDArray[np.float64]]:
    """Bin and share of each dot; and along each bin's middle, dots (-1 outside) and shares.

    The rays see to it that a bar thinner than a dot is drawn, too.
    """
    bin_of, distance = _polar(dial, width, height, fine, count)
    share = (distance - dial.ring) / (dial.rim - dial.ring)
    along = np.arange(dial.ring + 0.5, dial.rim, 0.25)
    along = along if along.size else np.array([dial.rim])
    turn = np.radians((np.arange(count) + 0.5) * 360 / count - 180)[:, None]
    down = np.sin(turn) * along * (1 if dial.y_down else -1)
    columns = np.floor(2 * (dial.x + np.cos(turn) * along)).astype(np.intp)
    rows = np.floor(fine * (dial.y + down / 2)).astype(np.intp)
    inside = (columns >= 0) & (columns < 2 * width) & (rows >= 0) & (rows < fine * height)
    rays = np.where(inside, rows * 2 * width + columns, -1)
    return bin_of, share, rays, (along - dial.ring) / (dial.rim - dial.ring)
