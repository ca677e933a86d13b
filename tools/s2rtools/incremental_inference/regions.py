"""Which part of a layer's output a changed part of its input can reach."""

from __future__ import annotations

from dataclasses import dataclass


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
        """The smallest region that holds both; an empty one adds nothing."""
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

    def outputs(self, size: int) -> int:
        return (size + 2 * self.padding - self.extent) // self.stride + 1

    def affected_outputs(self, start: int, stop: int, size: int) -> tuple[int, int]:
        """Outputs [lo, hi) that see any of the inputs [start, stop) of `size`."""
        low = max(0, -((self.extent - 1 - start - self.padding) // self.stride))
        high = min(self.outputs(size), (stop - 1 + self.padding) // self.stride + 1)
        return low, max(low, high)

    def sees(self, low: int, high: int) -> tuple[int, int]:
        """Padded inputs [start, stop) that the outputs [low, high) are computed from."""
        return low * self.stride, (high - 1) * self.stride + self.extent

    def then(self, after: SlidingWindow) -> SlidingWindow:
        """This window followed by an unpadded one, as one window."""
        extent = self.extent + (after.extent - 1) * self.stride
        return SlidingWindow(extent, self.stride * after.stride, self.padding)


def affected_region(
    region: PixelRegion, rows: SlidingWindow, cols: SlidingWindow, size: tuple[int, int]
) -> PixelRegion:
    """The outputs that see any of a region of an input of `size` rows and columns."""
    if region.empty:
        return PixelRegion(0, 0, 0, 0)
    r0, r1 = rows.affected_outputs(region.r0, region.r1, size[0])
    c0, c1 = cols.affected_outputs(region.c0, region.c1, size[1])
    return PixelRegion(r0, r1, c0, c1)
