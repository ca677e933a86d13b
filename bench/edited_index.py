"""Changing a published index behind the store's back, for what no writer of a store would do."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import duckdb

from s2rstore import layout


def edited(root: Path, statements: Sequence[str]) -> Path:
    """Run statements on the published index, state its new checksum, and give its path."""
    current = layout.read_current(root)
    index = root / current.index
    with duckdb.connect(str(index)) as connection:
        for statement in statements:
            connection.execute(statement)
    stated = {"sha256": layout.file_sha256(index), "bytes": index.stat().st_size}
    path = root / layout.CURRENT
    path.write_text(json.dumps({**json.loads(path.read_text()), **stated}))
    return index
