"""Regions of a layer's output that a changed input region affects, and patches of an image."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product


@dataclass(frozen=True, slots=True)
class PixelRegion:
    """Rows [r0, r1) and columns [c0, c1)."""

    r0: int
    r1: int
    c0: int
    c1: int

    @property
    def shape(self) -> tuple[int, int]:
        return self.r1 - self.r0, self.c1 - self.c0

    @property
    def empty(self) -> bool:
        return self.r0 >= self.r1 or self.c0 >= self.c1

    def union(self, other: PixelRegion) -> PixelRegion:
        """The smallest region that contains both."""
        if self.empty or other.empty:
            return other if self.empty else self
        return PixelRegion(
            min(self.r0, other.r0), max(self.r1, other.r1),
            min(self.c0, other.c0), max(self.c1, other.c1),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class SlidingWindow:
    """A sliding window along one axis: extent (dilation included), stride and padding."""

    extent: int
    stride: int
    padding: int

    def output_size(self, size: int) -> int:
        return (size + 2 * self.padding - self.extent) // self.stride + 1

    def affected_outputs(self, start: int, stop: int, size: int) -> tuple[int, int]:
        """Outputs [low, high) computed from any of the inputs [start, stop) of `size`."""
        low = max(0, -((self.extent - 1 - start - self.padding) // self.stride))
        high = min(self.output_size(size), (stop - 1 + self.padding) // self.stride + 1)
        return low, max(low, high)

    def required_inputs(self, low: int, high: int) -> tuple[int, int]:
        """Padded inputs [start, stop) from which the outputs [low, high) are computed."""
        return low * self.stride, (high - 1) * self.stride + self.extent

    def followed_by(self, after: SlidingWindow) -> SlidingWindow:
        """This window and a subsequent unpadded window, combined into one."""
        extent = self.extent + (after.extent - 1) * self.stride
        return SlidingWindow(extent, self.stride * after.stride, self.padding)


def affected_region(
    region: PixelRegion, rows: SlidingWindow, cols: SlidingWindow, size: tuple[int, int]
) -> PixelRegion:
    """The output region affected by a region of an input of `size` rows and columns."""
    if region.empty:
        return PixelRegion(0, 0, 0, 0)
    r0, r1 = rows.affected_outputs(region.r0, region.r1, size[0])
    c0, c1 = cols.affected_outputs(region.c0, region.c1, size[1])
    return PixelRegion(r0, r1, c0, c1)


def cut_patches(height: int, width: int, count: int = 6) -> list[PixelRegion]:
    """count x count patches, row by row, with edges at round(i * size / count)."""
    rows = [round(i * height / count) for i in range(count + 1)]
    cols = [round(i * width / count) for i in range(count + 1)]
    return [PixelRegion(*r, *c) for r, c in product(pairwise(rows), pairwise(cols))]
