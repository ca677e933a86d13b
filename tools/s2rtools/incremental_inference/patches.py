"""The patches that cover an image completely."""

from __future__ import annotations

from dataclasses import dataclass

from s2rtools.incremental_inference.regions import PixelRegion


@dataclass(frozen=True, slots=True)
class Patch:
    """Patch number `index`, in rows from the top left."""

    index: int
    region: PixelRegion


def cut_patches(height: int, width: int, count: int = 6) -> list[Patch]:
    """count x count patches with edges at round(i * size / count)."""
    rows = [round(i * height / count) for i in range(count + 1)]
    cols = [round(i * width / count) for i in range(count + 1)]
    return [
        Patch(r * count + c, PixelRegion(rows[r], rows[r + 1], cols[c], cols[c + 1]))
        for r in range(count)
        for c in range(count)
    ]
