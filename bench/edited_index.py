"""Edit a published index directly, for states that no writer of a store produces."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import duckdb

from s2rstore.files import input_files, layout

Statement = str | tuple[str, list[object]]


def edited(root: Path, statements: Sequence[Statement]) -> Path:
    """Run statements, some with parameters, on the published index and record its new checksum.

    Returns the path of the index.
    """
    current = layout.read_current(root)
    index = root / current.index
    index.chmod(0o644)
    with duckdb.connect(str(index)) as connection:
        for statement in statements:
            sql, parameters = (statement, []) if isinstance(statement, str) else statement
            connection.execute(sql, parameters)
        connection.execute("CHECKPOINT")
    stated = {"sha256": input_files.sha256(index), "bytes": index.stat().st_size}
    path = root / layout.CURRENT
    path.write_text(json.dumps({**json.loads(path.read_text()), **stated}))
    return index
