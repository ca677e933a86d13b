"""Importers, one module per layout of a data set; `IMPORTERS` lists them."""

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
