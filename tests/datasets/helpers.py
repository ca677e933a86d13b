"""Run an ingest with the options that the tests use."""

from __future__ import annotations

from pathlib import Path

from s2rtools.datasets import IMPORTERS
from s2rtools.datasets.build import build
from s2rtools.datasets.scan import Scan, ScanOptions

SIZE = (32, 32)


def ingest(layout: str, path: Path, store: Path, strict: bool = False, **options) -> Scan:
    scan = IMPORTERS[layout](path, ScanOptions(frame=SIZE, **options))
    build(scan, store, "s2r ingest", strict, lambda steps: None)
    return scan


def kinds(scan: Scan) -> dict[str, int]:
    counts: dict[str, int] = {}
    for issue in scan.issues:
        counts[issue.kind] = counts.get(issue.kind, 0) + 1
    return counts
