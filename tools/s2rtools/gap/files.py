"""Files of results: whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from s2rstore.errors import RequestError


def write_atomically(path: Path, content: str | bytes) -> None:
    """Write beside and rename; raises RequestError where the folder does not allow it."""
    data = content.encode() if isinstance(content, str) else content
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise RequestError(f"{path}: {error.strerror or error}") from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, 0o644)
        os.replace(name, path)
    except OSError as error:
        os.unlink(name)
        raise RequestError(f"{path}: {error.strerror or error}") from error
