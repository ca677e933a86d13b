"""Reading files that somebody else wrote: regular files only, of bounded size, parsed safely.

A pipe or a device would block or never end, and a huge or deeply nested document would exhaust
memory; each of them is a RequestError that names the file.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError

MOST_JSON = 8 << 20
"""Bytes of a JSON document. Parsed, it takes up to 50 times as much memory."""
MOST_TOML = 1 << 20
"""Bytes of a TOML document: a thousand times what the configurations here need."""
_MOST_KEY_PARTS = 32
"""Maximum parts of a dotted TOML key; tomllib needs memory quadratic in their number."""
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_TOML_TOKEN = re.compile(
    r"""(?P<key>"(?:[^"\\\n]|\\.)*"|'[^'\n]*'|[\w+-]+)|(?P<dot>\.)|(?P<blank>[ \t]+)|.|\n""", re.S
)


def check_regular(path: Path) -> os.stat_result:
    """The file's status. Raises RequestError where it is missing or no regular file."""
    try:
        found = path.stat()
    except (OSError, ValueError) as error:
        raise RequestError(f"{path}: cannot be read ({_reason(error)})") from error
    _refuse_special(path, found)
    return found


@contextmanager
def open_regular(path: Path) -> Iterator[io.BufferedReader]:
    """Open a regular file for reading, without waiting for a pipe's other end."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        special = path.exists() and not path.is_file()
        if special:
            _refuse_special(path, path.stat())
        raise RequestError(f"{path}: cannot be read ({_reason(error)})") from error
    try:
        _refuse_special(path, os.fstat(descriptor))
        file = os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise
    with file:
        try:
            yield file
        except OSError as error:
            raise RequestError(f"{path}: cannot be read ({_reason(error)})") from error


def read_bytes(path: Path, most: int) -> bytes:
    """Read a regular file of at most `most` bytes; RequestError for anything else."""
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > most:
            raise RequestError(f"{path}: {size:,} bytes; at most {most:,} are read")
        content = bytearray()
        while block := file.read(min(1 << 24, most + 1 - len(content))):
            content += block
            if len(content) > most:
                raise RequestError(f"{path}: more than {most:,} bytes, which is the most read")
    return bytes(content)


def read_text(path: Path, most: int) -> str:
    """The text of a UTF-8 file; a byte order mark is dropped."""
    try:
        return read_bytes(path, most).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RequestError(f"{path}: not UTF-8 at byte {error.start}; save it as UTF-8") from error


def sha256(path: Path) -> str:
    """SHA-256 of a regular file of any size."""
    with open_regular(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def read_json(path: Path, most: int = MOST_JSON) -> Any:
    """The value of a JSON file of at most `most` bytes; RequestError for anything else."""
    return parse_json(read_text(path, most), str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The table of a TOML file; RequestError for anything that is no TOML."""
    text = read_text(path, MOST_TOML)
    try:
        _check_keys(text)
        return tomllib.loads(text)
    except RecursionError:
        raise RequestError(f"{path}: no TOML that can be read (nested too deeply)") from None
    except ValueError as error:
        raise RequestError(f"{path}: no TOML ({_reason(error)})") from error


def read_document(path: Path) -> Any:
    """A JSON file where the suffix is `.json`, else TOML."""
    return read_json(path) if path.suffix.lower() == ".json" else read_toml(path)


def parse_json(text: str | bytes, where: str) -> Any:
    """The value of a JSON text; RequestError, beginning with `where`, for anything else.

    A key that an object holds twice is refused, because readers differ in which one counts.
    """
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except RecursionError:
        raise RequestError(f"{where}: no JSON that can be read (nested too deeply)") from None
    except ValueError as error:
        raise RequestError(f"{where}: no JSON ({_reason(error)})") from error


def parse_object(text: str | bytes, where: str) -> dict[str, Any]:
    """The same for a text that must be a JSON object."""
    found = parse_json(text, where)
    if not isinstance(found, dict):
        raise RequestError(f"{where}: no JSON object")
    return found


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    made = dict(pairs)
    if len(made) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"key {twice[:80]!r} stands twice")
    return made


def _check_keys(text: str) -> None:
    """Raises ValueError for a dotted key of too many parts."""
    parts, dotted = 0, False
    for token in _TOML_TOKEN.finditer(text):
        if token["key"] is not None:
            parts = parts + 1 if dotted else 1
        elif token["dot"] is None and token["blank"] is None:
            parts = 0
        if parts > _MOST_KEY_PARTS:
            line = text.count("\n", 0, token.start()) + 1
            raise ValueError(f"line {line}: a key of more than {_MOST_KEY_PARTS} parts")
        if token["blank"] is None:
            dotted = token["dot"] is not None and parts > 0


def _refuse_special(path: Path, found: os.stat_result) -> None:
    for is_kind, kind in _KINDS:
        if is_kind(found.st_mode):
            raise RequestError(f"{path}: {kind}, not a regular file")


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return (str(error).splitlines() or [type(error).__name__])[0][:200]
