"""The interface between a plot widget and inline images in true pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from textual.geometry import Region
from textual.strip import Strip

from s2rtui.canvas import Canvas


@dataclass(frozen=True, slots=True)
class PaintedStrips:
    """Strips that contain inline images, and the (region, image number) of each."""

    strips: list[Strip]
    places: frozenset[tuple[Region, int]]


class ImageHost(Protocol):
    """Shows the inline images of a canvas."""

    def debounce_seconds(self, view: str) -> float:
        """Seconds without another drawing before the images of a view are sent."""

    def attach(self, view: str, canvas: Canvas, strips: list[Strip]) -> PaintedStrips:
        """Put the images of a canvas into its strips."""
