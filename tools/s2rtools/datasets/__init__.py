"""From paired images to a published store: `IMPORTERS` lists where they may come from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from s2rtools.datasets.importers import csv_manifest, sim2realviz, world
from s2rtools.datasets.scan import Scan, ScanOptions

Importer = Callable[[Path, ScanOptions], Scan]

IMPORTERS: dict[str, Importer] = {
    "sim2realviz": sim2realviz.scan,
    "csv": csv_manifest.scan,
    "world": world.scan,
}
