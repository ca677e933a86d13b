"""Sizes of networks and of the images that they translate, with their limits."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

MAX_CHANNELS, MAX_BLOCKS = 128, 16
MAX_EDGE = 1024
"""Pixels of the longer edge of images at the working size."""
MAX_VALUES = 32 << 20
"""Values of one feature map at the working size (pixels times channels)."""


@dataclass(frozen=True, slots=True)
class GeneratorSize:
    """Channels at full resolution, residual blocks, and the limit of the change.

    `bound` is the largest change of an image in -1 .. 1; 2 reaches every colour from every colour.
    Raises ValueError for values out of range.
    """

    channels: int = 16
    blocks: int = 4
    bound: float = 2.0

    def __post_init__(self) -> None:
        whole = type(self.channels) is int and type(self.blocks) is int
        if not whole or not 1 <= self.channels <= MAX_CHANNELS:
            raise ValueError(f"channels {self.channels}: a whole number up to {MAX_CHANNELS}")
        if not 1 <= self.blocks <= MAX_BLOCKS:
            raise ValueError(f"blocks {self.blocks}: a whole number up to {MAX_BLOCKS}")
        if type(self.bound) not in (int, float) or not 0 < self.bound <= 2:
            raise ValueError(f"bound {self.bound}: a number above 0, at most 2")

    def document(self) -> dict[str, Any]:
        return asdict(self)


def check_working_size(size: tuple[int, int], channels: int) -> None:
    """Raise ValueError where features at a working size (rows, columns) need too much memory.

    The pixels are those of a square with the longer edge, because images may have any aspect.
    """
    edge = max(size)
    if edge > MAX_EDGE:
        raise ValueError(f"images of {edge} pixels; networks translate up to {MAX_EDGE}")
    if edge**2 * channels > MAX_VALUES:
        most = int((MAX_VALUES / channels) ** 0.5)
        raise ValueError(f"images of {edge} pixels with {channels} channels; at most {most} pixels")
