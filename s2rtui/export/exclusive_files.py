"""Files that replace no other one, and that appear when they are whole."""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, count
from pathlib import Path
from typing import TypeVar

from s2rstore.errors import RequestError

T = TypeVar("T")


def numbered(folder: Path, stem: str, suffix: str) -> Iterator[Path]:
    """`stem-001`, `stem-002`, ... without end."""
    return (folder / f"{stem}-{number:03d}{suffix}" for number in count(1))


def file(first: Path, fill: Callable[[Path], T], others: Iterable[Path] = ()) -> tuple[Path, T]:
    """Fill a file, and give it the first name that no other one has; that name, what `fill` gave.

    `others` are of the same folder and kind. Raises RequestError where all names are taken; what
    `fill` raises leaves no file, and is told of the first name.
    """
    beside = first.with_name(f".{secrets.token_hex(4)}.{first.name}")
    try:
        filled = fill(beside)
        for name in chain((first,), others):
            if _claimed(name):
                beside.replace(name)
                return name, filled
    except RequestError as error:
        raise RequestError(str(error).replace(str(beside), str(first))) from error
    except OSError as error:
        if error.filename == str(beside):
            error.filename = str(first)
        raise
    finally:
        beside.unlink(missing_ok=True)
    raise RequestError(f"{first}: is there already")


def _claimed(name: Path) -> bool:
    """Whether the name was free; an empty file has it now."""
    try:
        with name.open("xb"):
            return True
    except FileExistsError:
        return False
