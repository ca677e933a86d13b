"""What applying a translator to files reports, and how its results appear: whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from s2rstore.errors import RequestError


@dataclass(frozen=True, slots=True)
class Translated:
    """Number of translated images, and of those that could not be decoded."""

    translated: int
    undecodable: int = 0

    def summary(self) -> str:
        """One phrase for the user."""
        images = f"{self.translated} image{'s' * (self.translated != 1)} translated"
        return f"{images}, {self.undecodable} undecodable" if self.undecodable else images


@contextmanager
def publish_at(target: Path) -> Iterator[Path]:
    """A path to write to, which becomes `target` at the end and is removed after an error.

    Raises RequestError if `target` exists or its folder does not.
    """
    if os.path.lexists(target):
        raise RequestError(f"{target}: exists; give a new name")
    if not target.parent.is_dir():
        raise RequestError(f"{target.parent}: no such folder")
    folder = target.with_name(f".{target.name}-{secrets.token_hex(4)}.part")
    try:
        folder.mkdir()
        part = folder / target.name
        yield part
        if os.path.lexists(target):
            raise RequestError(f"{target}: exists; give a new name")
        part.rename(target)
    except OSError as error:
        raise RequestError(f"{target}: cannot be written ({error.strerror or error})") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)
