"""Strips with inline images: images as escape codes, half blocks as segments."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from textual.strip import Strip

from s2rtui.canvas import InlineImage
from s2rtui.terminal.strips import DeltaStrip, Runs, encoded


@dataclass(frozen=True, slots=True)
class ImageSpan:
    """Cells `start` to `end` of a row; `codes(first, count)` gives the escape codes of some.

    `skipped` cells of the image's row lie at the left of it. A span without cells writes its codes
    before the cell `start`.
    """

    start: int
    end: int
    codes: Callable[[int, int], str]
    skipped: int = 0

    def cut(self, start: int, end: int) -> ImageSpan | None:
        """The part within the cells from `start` to `end`; None if there is none."""
        if self.start == self.end:
            inside = start <= self.start < end
            return ImageSpan(self.start - start, self.start - start, self.codes) if inside else None
        first, last = max(self.start, start), min(self.end, end)
        if first >= last:
            return None
        return ImageSpan(first - start, last - start, self.codes, self.skipped + first - self.start)


class ImageStrip(DeltaStrip):
    """A strip whose spans show images, unless it is restyled."""

    __slots__ = ("_spans",)

    def __init__(self, runs: Runs, spans: Sequence[ImageSpan]) -> None:
        """`spans` from left to right, without overlap."""
        super().__init__(runs)
        self._spans = tuple(spans)

    def crop(self, start: int, end: int | None = None) -> Strip:
        whole = self.cell_length
        start, end = max(0, start), whole if end is None else min(whole, end)
        cropped = super().crop(start, end)
        if cropped is self or not isinstance(cropped, DeltaStrip):
            return cropped
        spans = (span.cut(start, end) for span in self._spans)
        return ImageStrip(cropped.runs, [span for span in spans if span is not None])

    def encode(self) -> str:
        parts, at = [], 0
        for span in self._spans:
            parts.append(self._between(at, span.start))
            parts.append(span.codes(span.skipped, span.end - span.start))
            at = span.end
        parts.append(self._between(at, self.cell_length))
        return "".join(parts)

    def _between(self, start: int, end: int) -> str:
        return encoded(self.runs.cut(start, end)) if start < end else ""


def with_spans(strip: Strip, spans: Sequence[ImageSpan]) -> Strip:
    """Put image spans into a strip of a canvas."""
    if not spans or not isinstance(strip, DeltaStrip):
        return strip
    return ImageStrip(strip.runs, sorted(spans, key=lambda span: (span.start, span.end)))


def uncovered(image: InlineImage, row: int) -> list[tuple[int, int]]:
    """The runs of cells (start, end) of a row of the image's box that hold no text."""
    if image.text is None:
        return [(0, image.width)]
    free = np.concatenate([[False], ~image.text[row], [False]])
    edges = np.flatnonzero(free[1:] != free[:-1]).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
