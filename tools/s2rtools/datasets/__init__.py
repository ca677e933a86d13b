"""Data sets: read paired images with poses, or images without, and write them as a store.

`IMPORTERS` maps the name of a whole data set's layout to a function `scan(path, options) -> Scan`;
each is one module in `importers/`. `layouts.LAYOUTS` does so for recordings, which are one side of
a data set: `read(layout, path)` returns a `Recording`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from s2rtools.datasets.importers import csv_manifest, images, sim2realviz, synthetic_world
from s2rtools.datasets.layouts import read
from s2rtools.datasets.recording import Layout, ReadOptions, Recording
from s2rtools.datasets.scan import Scan, ScanOptions

__all__ = [
    "IMPORTERS",
    "Importer",
    "Layout",
    "ReadOptions",
    "Recording",
    "Scan",
    "ScanOptions",
    "read",
]

Importer = Callable[[Path, ScanOptions], Scan]

IMPORTERS: dict[str, Importer] = {
    "sim2realviz": sim2realviz.scan,
    "csv": csv_manifest.scan,
    "world": synthetic_world.scan,
    "images": images.scan,
}
