"""Files of results: whole or not at all."""

from __future__ import annotations

from pathlib import Path

from s2rstore import layout
from s2rstore.errors import RequestError


def write_atomically(path: Path, content: str | bytes) -> None:
    """Raises RequestError where the folder does not allow it."""
    data = content.encode() if isinstance(content, str) else content
    try:
        layout.write_atomic(path, data)
    except OSError as error:
        raise RequestError(f"{path}: {error.strerror or error}") from error
