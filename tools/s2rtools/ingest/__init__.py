"""From paired images to a published store: `IMPORTERS` lists where they may come from."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from s2rtools.ingest import manifest, sim2realviz, world
from s2rtools.ingest.scan import Scan, ScanOptions

Importer = Callable[[Path, ScanOptions], Scan]

IMPORTERS: dict[str, Importer] = {
    "sim2realviz": sim2realviz.scan,
    "csv": manifest.scan,
    "world": world.scan,
}
