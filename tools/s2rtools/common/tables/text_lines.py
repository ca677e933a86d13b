"""Read the lines of a text file of unknown origin, within size limits."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files.input_files import open_regular

_MAX_BYTES = 256 << 20
"""Bytes of a file; a manifest has about 150 per row."""
_MAX_LINE_BYTES = 1 << 20
"""Bytes of a line."""


def read_lines(path: Path, kind: str = "text") -> Iterator[tuple[int, str]]:
    """Yield the number and the text of each line, with its line break.

    A byte order mark is dropped. `kind` names the expected format in messages. Raises RequestError,
    naming file and line, if the file is too large or not UTF-8.
    """
    with open_regular(path) as file:
        if os.fstat(file.fileno()).st_size > _MAX_BYTES:
            raise RequestError(f"{path}: larger than {_MAX_BYTES:,} bytes; split it")
        number = 0
        while line := file.readline(_MAX_LINE_BYTES + 1):
            number += 1
            if len(line) > _MAX_LINE_BYTES:
                limit = f"longer than {_MAX_LINE_BYTES:,} bytes"
                raise RequestError(f"{path}:{number}: {limit}; not a {kind} file")
            if b"\0" in line:
                raise RequestError(f"{path}:{number}: contains NUL bytes; not a {kind} file")
            try:
                yield number, line.decode("utf-8-sig" if number == 1 else "utf-8")
            except UnicodeDecodeError as error:
                raise RequestError(f"{path}:{number}: not UTF-8; save it as UTF-8") from error
