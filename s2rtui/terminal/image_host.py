"""What a view asks of whoever draws its pictures in true pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from textual.geometry import Region
from textual.strip import Strip

from s2rtui.canvas import Canvas


@dataclass(frozen=True, slots=True)
class PaintedStrips:
    """Strips with pictures in them, and where each of these hangs; a number stands for one."""

    strips: list[Strip]
    places: frozenset[tuple[Region, int]]


class ImageHost(Protocol):
    """Draws a canvas' pictures in true pixels."""

    def rest(self, view: str) -> float:
        """Seconds without another drawing until its pictures are worth sending."""

    def hang(self, view: str, canvas: Canvas, strips: list[Strip]) -> PaintedStrips:
        """The strips with the canvas' pictures in them."""
