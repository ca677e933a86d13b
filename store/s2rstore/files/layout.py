"""The layout of a store folder, and the file that names the published generation."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import msgspec

from s2rstore.errors import RequestError, shortened
from s2rstore.files import atomic_writes, safe_files
from s2rstore.files.documents import decode_json
from s2rstore.files.store_files import LocalFiles, StoreFiles
from s2rstore.records import HASH, NAME

CURRENT = "CURRENT.json"
INDEX = "index"
FRAMES = "frames.zarr"
LABEL_IMAGES = "labels-"
"""What the names of arrays of label images begin with; the key of their values follows."""
RUNS = "runs.zarr"
LEDGER = "ledger"
UNITS = "units"
SHARED_ARRAYS = "_shared"
"""Folder of arrays that several runs use, in the place of a run's name."""
MODELS = "models"
ASSETS = "assets"
HISTORY = "history"
GAP_HISTORY = f"{HISTORY}/gap.jsonl"
DRIVES = "drives"
TRANSLATORS = "translators"

_CURRENT_BYTES = 65_536


class Current(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of `CURRENT.json`: which index file is the published state."""

    generation: int
    index: str
    sha256: str
    bytes: int
    schema: int
    dataset_hash: str


def index_name(generation: int) -> str:
    return f"{INDEX}/index-{generation:06d}.duckdb"


def generation_of(path: Path) -> int | None:
    """The generation that an index file's name states; None for other files."""
    match = re.fullmatch(r"index-(\d{6,})\.duckdb", path.name)
    return int(match[1]) if match else None


def read_current(root: Path) -> Current:
    """The published generation of the store in the folder `root`, see `current_of`."""
    return current_of(LocalFiles(root))


def current_of(files: StoreFiles) -> Current:
    """The published generation of a store.

    Raises RequestError where there is no store, or one that cannot be read.
    """
    path = files.path / CURRENT
    try:
        content = files.read(CURRENT, _CURRENT_BYTES)
    except (FileNotFoundError, NotADirectoryError):
        raise RequestError(f"{files.path}: {files.absence}") from None
    except OSError as error:
        where, reason = error.filename or path, safe_files.error_text(error)
        raise RequestError(f"{where}: cannot be read ({reason}); check its permissions") from error
    current = decode_json(content, Current, str(path))
    if current.index != index_name(current.generation):
        raise RequestError(f"{path}: damaged (generation and index do not agree); restore it")
    return current


def write_current(root: Path, current: Current, check: Callable[[], None] = lambda: None) -> None:
    """Make `current` the published generation, atomically and durably.

    `check` is called directly before that; what it raises leaves the present generation.
    """
    content = msgspec.json.format(msgspec.json.encode(current)) + b"\n"
    atomic_writes.write(root, CURRENT, content, check=check)


def checked_hash(text: object, what: str) -> str:
    """Return `text`; raise RequestError unless it is 16 to 64 lowercase hexadecimal digits."""
    if not isinstance(text, str) or not re.match(HASH, text):
        raise RequestError(f"{what} {repr(text)[:80]}: not 16 to 64 hexadecimal digits (0-9, a-f)")
    return text


def checked_name(name: str, what: str) -> str:
    """Return `name`; raise RequestError unless it can name a folder and stand in an expression."""
    if not re.match(NAME, name):
        allowed = "letters, digits and _ . + - (at most 80, the first no sign)"
        raise RequestError(f"{what} {shortened(name)!r}: use {allowed}")
    return name
