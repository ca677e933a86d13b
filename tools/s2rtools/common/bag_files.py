"""Checks of ROS bags of unknown origin before a reader opens them."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from s2rstore.errors import RequestError, S2RError, one_line
from s2rstore.files.input_files import check_regular

BAG_SUFFIXES = (".bag", ".mcap", ".db3")
"""Of a bag in one file; one in a folder has a metadata.yaml."""
READING_MEMORY = 384 << 20
"""Memory limit for reading a bag, in bytes; recorders write chunks of about a megabyte."""
LARGEST_UNPACKED = 2 << 30
"""Largest bag, in bytes, that is unpacked into a temporary folder if compressed as a whole."""
_MOST_METADATA = 1 << 20


def check_bag(path: Path) -> None:
    """Raise RequestError if a bag is missing, incomplete, or holds files that no recorder writes.

    These are pipes, devices, links to other folders, and views in a database.
    """
    if not path.exists():
        raise RequestError(f"{path}: no such bag")
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        raise RequestError(f"{path}: no metadata.yaml in it; a ROS 2 bag is a folder with one")
    files = [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if not file.is_dir())
        root = path.resolve()
        for file in files:
            if not file.resolve().is_relative_to(root):
                raise RequestError(f"{file}: a link to outside the bag; copy the file into it")
        if check_regular(path / "metadata.yaml").st_size > _MOST_METADATA:
            raise RequestError(f"{path / 'metadata.yaml'}: larger than {_MOST_METADATA:,} bytes")
    for file in files:
        check_regular(file)
        if file.suffix.lower() == ".db3":
            _check_tables(file)


@contextmanager
def refusing_damage(path: Path) -> Iterator[None]:
    """Turn errors of reading a bag into RequestErrors that name it.

    A damaged bag, and one whose messages are not of their declared types, fails in every layer
    below the reader, and with every type of error.
    """
    try:
        yield
    except S2RError:
        raise
    except Exception as error:
        raise unreadable(path, error) from error


def unreadable(path: Path, error: Exception, memory: int = READING_MEMORY) -> RequestError:
    """The error for a bag in which the reader failed with `memory` bytes as its limit."""
    text = one_line(error)
    if isinstance(error, MemoryError):
        return RequestError(
            f"{path}: reading it takes more than {memory >> 20} MB; split it, or copy it again if "
            "it is damaged"
        )
    if "not supported" in text:
        reason = f"{text.rstrip('.')}; record or convert it in another format"
    elif "index" in text.lower():
        reason = "its index is missing or damaged; copy it again, or reindex it"
    else:
        reason = "it is damaged, cut short or of another format; copy it again"
    return RequestError(f"{path}: cannot be read as a ROS bag: {reason}")


def _check_tables(path: Path) -> None:
    """Refuse views and virtual tables: recorders write none, and queries could run forever."""
    odd = "type IN ('view', 'trigger') OR sql LIKE 'CREATE VIRTUAL%'"
    query = f"SELECT name FROM sqlite_master WHERE {odd}"
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as database:
            row = database.execute(query).fetchone()
    except (sqlite3.Error, UnicodeDecodeError):  # the latter for its own message
        return  # the reader reports the reason
    if row is not None:
        raise RequestError(f"{path}: {row[0]!r} is not a table; no recorder writes such a bag")
