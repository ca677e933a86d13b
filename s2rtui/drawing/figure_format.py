"""How figures are written: file format, size of fonts, resolution, title and colour map."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from s2rstore.errors import RequestError
from s2rtui.canvas import Pixels as ColourTable
from s2rtui.canvas import turbo

FileFormat = Literal["png", "svg", "pdf"]
Form = FileFormat | Literal["rgb"]
"""A format of files, or the pixels themselves, 3 bytes each, row by row."""
COLOUR_MAPS = ("turbo", "viridis", "plasma", "inferno", "magma", "cividis")
"""Colour maps of continuous values: perceptually uniform ones, and turbo."""


@dataclass(frozen=True, slots=True)
class FigureFormat:
    """How all figures of a context are written.

    type_size enlarges fonts and lines of a page whose fonts scale with its pixels. dpi: pixels per
    inch of a page with a physical size, whose fonts have their size in points; None for the other
    pages. title replaces the title of the figure. colour_map: one of `COLOUR_MAPS`.
    """

    form: Form = "png"
    type_size: float = 1.0
    dpi: float | None = None
    title: str | None = None
    colour_map: str = "turbo"


_format: ContextVar[FigureFormat] = ContextVar("format", default=FigureFormat())  # noqa: B039


@contextmanager
def figure_format(form: FigureFormat) -> Iterator[None]:
    """Inside this context figures are written in a format."""
    before = _format.set(form)
    try:
        yield
    finally:
        _format.reset(before)


def present_format() -> FigureFormat:
    """The format of the innermost context."""
    return _format.get()


def check_colour_map(name: str) -> None:
    """Raise RequestError for a colour map that is not one of `COLOUR_MAPS`."""
    if name not in COLOUR_MAPS:
        raise RequestError(f"--cmap {name}: must be one of {', '.join(COLOUR_MAPS)}")


def value_colours(shares: ArrayLike) -> ColourTable:
    """Map numbers 0 .. 1 (clipped; NaN counts as 0) of any shape to uint8 colours (..., 3)."""
    name = present_format().colour_map
    if name == "turbo":
        return turbo(shares)
    from matplotlib import colormaps

    fractions = np.clip(np.nan_to_num(np.asarray(shares, dtype=np.float64)), 0.0, 1.0)
    return np.asarray(colormaps[name](fractions, bytes=True)[..., :3])
