"""Read files of unknown origin: regular files only, of bounded size, parsed safely.

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
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from s2rstore.errors import RequestError, first_line

T = TypeVar("T")

MAX_JSON_BYTES = 8 << 20
"""Bytes of a JSON document. Parsed, it takes up to 50 times as much memory."""
MAX_TOML_BYTES = 1 << 20
"""Bytes of a TOML document: a thousand times what the configurations here need."""
_MAX_KEY_PARTS = 32
"""Maximum parts of a dotted TOML key; tomllib needs memory quadratic in their number."""
_LEAST, _MOST = 1 << 16, 1 << 24
"""Bytes that are requested at a time."""
_SPECIAL_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)
_TOML_TOKEN = re.compile(
    r"""(?P<key>"(?:[^"\\\n]|\\.)*"|'[^'\n]*'|[\w+-]+)|(?P<dot>\.)|(?P<blank>[ \t]+)|.|\n""", re.S
)


def refuse_special(path: Path, mode: int) -> None:
    """Raise RequestError where a file's mode is that of a folder, a pipe, a socket or a device."""
    for is_kind, kind in _SPECIAL_KINDS:
        if is_kind(mode):
            raise RequestError(f"{path}: {kind}, not a regular file")


def check_regular(path: Path) -> os.stat_result:
    """The file's status. Raises RequestError where it is missing or no regular file."""
    try:
        status = path.stat()
    except (OSError, ValueError) as error:
        raise RequestError(f"{path}: cannot be read ({_reason(error)})") from error
    refuse_special(path, status.st_mode)
    return status


@contextmanager
def open_regular(path: Path) -> Iterator[io.BufferedReader]:
    """Open a regular file for reading, without waiting for a pipe's other end."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except (OSError, ValueError) as error:
        if path.exists():
            refuse_special(path, path.stat().st_mode)
        raise RequestError(f"{path}: cannot be read ({_reason(error)})") from error
    try:
        refuse_special(path, os.fstat(descriptor).st_mode)
        file = os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise
    with file:
        try:
            yield file
        except OSError as error:
            raise RequestError(f"{path}: cannot be read ({_reason(error)})") from error


def read_bytes(path: Path, limit: int) -> bytes:
    """Read a regular file of at most `limit` bytes; RequestError for anything else."""
    with open_regular(path) as file:
        return content_of(file, path, limit)


def content_of(file: io.BufferedIOBase | io.FileIO, path: Path, limit: int) -> bytes:
    """The content of an open file; RequestError where it has more than `limit` bytes."""
    size = os.fstat(file.fileno()).st_size
    if size > limit:
        raise RequestError(f"{path}: {size:,} bytes; at most {limit:,} are read")
    content = bytearray()
    while block := file.read(
        min(max(size - len(content), _LEAST), _MOST, limit - len(content)) + 1
    ):
        content += block
        if len(content) > limit:
            raise RequestError(f"{path}: more than {limit:,} bytes, the limit")
    return bytes(content)


def read_text(path: Path, limit: int) -> str:
    """The text of a UTF-8 file; a byte order mark is dropped."""
    try:
        return read_bytes(path, limit).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RequestError(f"{path}: not UTF-8 at byte {error.start}; save it as UTF-8") from error


def stamp(path: Path) -> tuple[int, int, int] | None:
    """A value that changes when a file is replaced; None where it is missing."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_ino, status.st_mtime_ns, status.st_size


def sha256(path: Path) -> str:
    """SHA-256 of a regular file of any size."""
    with open_regular(path) as file:
        return digest(file)


def digest(file: io.BufferedIOBase | io.FileIO) -> str:
    """SHA-256 of an open file's content, in hexadecimal."""
    return hashlib.file_digest(file, "sha256").hexdigest()


def read_json(path: Path, limit: int = MAX_JSON_BYTES) -> Any:
    """The value of a JSON file of at most `limit` bytes; RequestError for anything else."""
    return parse_json(read_text(path, limit), str(path))


def read_toml(path: Path) -> dict[str, Any]:
    """The table of a TOML file; RequestError for any other content."""
    text = read_text(path, MAX_TOML_BYTES)
    with _refusing(f"{path}: not valid TOML"):
        _check_keys(text)
        return tomllib.loads(text)


def read_document(path: Path) -> Any:
    """A JSON file where the suffix is `.json`, else TOML."""
    return read_json(path) if path.suffix.lower() == ".json" else read_toml(path)


def parse_json(text: str | bytes, where: str) -> Any:
    """The value of a JSON text; RequestError, beginning with `where`, for anything else.

    Duplicate keys of an object are refused, because readers differ in which one counts.
    """
    with _refusing(f"{where}: not valid JSON"):
        return json.loads(text, object_pairs_hook=_unique)


def decode_json(content: bytes, kind: type[T], where: str) -> T:
    """A JSON text as a record whose fields have the declared types.

    Raises RequestError, which begins with `where` and names the wrong field and the valid type.
    """
    with _refusing(f"{where}: damaged", "; restore it"):
        return msgspec.json.decode(content, type=kind)


@contextmanager
def _refusing(problem: str, advice: str = "") -> Iterator[None]:
    """Turn errors of a parser into RequestErrors that state the problem and the reason."""
    try:
        yield
    except RecursionError:
        raise RequestError(f"{problem} (nested too deeply){advice}") from None
    except (msgspec.DecodeError, ValueError) as error:
        raise RequestError(f"{problem} ({_reason(error)}){advice}") from error


def parse_object(text: str | bytes, where: str) -> dict[str, Any]:
    """The value of a JSON text that must be an object; see `parse_json`."""
    value = parse_json(text, where)
    if not isinstance(value, dict):
        raise RequestError(f"{where}: not a JSON object")
    return value


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    counts = Counter(key for key, _ in pairs)
    for key, count in counts.items():
        if count > 1:
            raise ValueError(f"duplicate key {key[:80]!r}")
    return dict(pairs)


def _check_keys(text: str) -> None:
    """Raises ValueError for a dotted key of too many parts."""
    parts, dotted = 0, False
    for token in _TOML_TOKEN.finditer(text):
        if token["key"] is not None:
            parts = parts + 1 if dotted else 1
        elif token["dot"] is None and token["blank"] is None:
            parts = 0
        if parts > _MAX_KEY_PARTS:
            line = text.count("\n", 0, token.start()) + 1
            raise ValueError(f"line {line}: a key of more than {_MAX_KEY_PARTS} parts")
        if token["blank"] is None:
            dotted = token["dot"] is not None and parts > 0


def _reason(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return first_line(error)[:200]
