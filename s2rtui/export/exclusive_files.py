"""Creation of files and folders that replace no other ones and appear only when complete."""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator
from itertools import chain, count
from pathlib import Path
from typing import TypeVar

from s2rstore.errors import RequestError

T = TypeVar("T")


def numbered_paths(folder: Path, stem: str, suffix: str) -> Iterator[Path]:
    """Yield `stem-001`, `stem-002`, ... without end."""
    return (folder / f"{stem}-{number:03d}{suffix}" for number in count(1))


def create_exclusive(
    first: Path, fill: Callable[[Path], T], alternatives: Iterable[Path] = ()
) -> tuple[Path, T]:
    """Create a file or a folder under the first free name; return it and the result of `fill`.

    `fill` writes to a temporary name; if it raises, nothing remains and the exception names
    `first`. `alternatives` are in the same folder and have the same suffix. Raises RequestError
    if all names are taken.
    """
    temporary = first.with_name(f".{secrets.token_hex(4)}.{first.name}")
    try:
        result = fill(temporary)
        for name in chain((first,), alternatives):
            if _reserve(name, temporary.is_dir()):
                temporary.replace(name)
                return name, result
    except RequestError as error:
        raise RequestError(str(error).replace(str(temporary), str(first))) from error
    except OSError as error:
        if error.filename == str(temporary):
            error.filename = str(first)
        raise
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary)
        else:
            temporary.unlink(missing_ok=True)
    raise RequestError(f"{first}: exists already; choose another name")


def _reserve(name: Path, is_folder: bool) -> bool:
    """Create an empty file or folder; return False if the name is taken."""
    try:
        if is_folder:
            name.mkdir()
        else:
            name.touch(exist_ok=False)
        return True
    except FileExistsError:
        return False
