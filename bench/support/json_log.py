"""A log of JSON objects, one per line, which an interrupted measurement continues."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def read_log(path: Path) -> list[dict[str, Any]]:
    """The objects of a log without an unfinished last line; none where the file does not exist."""
    if not path.exists():
        return []
    finished, _, _ = path.read_text().rpartition("\n")
    return [json.loads(line) for line in finished.splitlines() if line]


def append_log(path: Path, row: dict[str, Any]) -> None:
    """Append an object as one line, in place of an unfinished last line."""
    path.touch()
    with path.open("r+b") as file:
        content = file.read()
        file.truncate(content.rfind(b"\n") + 1)
        file.seek(0, 2)
        file.write(json.dumps(row).encode() + b"\n")
