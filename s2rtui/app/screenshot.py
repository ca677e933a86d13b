"""The screen as styled text, taken on the UI thread and encoded anywhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from rich.segment import Segment
from textual.screen import Screen

from s2rtui.canvas import RenderOptions
from s2rtui.terminal.textual_compat import screen_strips


@dataclass(frozen=True, slots=True)
class Screenshot:
    """The lines of a screen as styled segments."""

    lines: tuple[tuple[Segment, ...], ...]

    @classmethod
    def of(cls, screen: Screen[Any]) -> Screenshot:
        """Take the present content of a screen."""
        return cls(tuple(tuple(strip) for strip in screen_strips(screen)))

    @property
    def text(self) -> str:
        """The characters, without blanks at the ends of lines."""
        rows = ("".join(segment.text for segment in line).rstrip() for line in self.lines)
        return "\n".join(rows) + "\n"

    def png(self, options: RenderOptions, size: tuple[int, int] | None = None) -> bytes:
        """Encode as PNG, in the upper left of an image of `size` pixels if it is set."""
        from s2rtui.export.rasterizer import rasterize_png

        return rasterize_png(self.lines, theme=options.theme, size=size)
