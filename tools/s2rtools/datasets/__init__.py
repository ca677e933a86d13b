"""Data sets: read paired images with poses, or images without, and write them as a store.

Registry: `IMPORTERS` maps a layout's name to a function `scan(path, options) -> Scan`. To add an
importer, write one module in `importers/` and add one line to `IMPORTERS`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from s2rtools.datasets.importers import csv_manifest, images, sim2realviz, synthetic_world
from s2rtools.datasets.scan import Scan, ScanOptions

Importer = Callable[[Path, ScanOptions], Scan]

IMPORTERS: dict[str, Importer] = {
    "sim2realviz": sim2realviz.scan,
    "csv": csv_manifest.scan,
    "world": synthetic_world.scan,
    "images": images.scan,
}
