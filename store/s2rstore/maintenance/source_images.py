"""Compare the image files that a store was made from with the checksums in table `frame`.

A JPEG has no checksum, so that a decoder cannot tell every damaged file from a whole one. The index
states the SHA-256 of each frame's files as they were ingested.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath

from s2rstore.errors import RequestError, first_line
from s2rstore.files import input_files
from s2rstore.maintenance.table_rules import Damage
from s2rstore.reader import Store

_MAX_BYTES = 1 << 30
"""Bytes of an image file; larger ones are never ingested."""
_BLOCK = 8192
_FRAMES = """
    SELECT rgb_path, depth_path, sha256 FROM frame
    WHERE domain = ? AND iid >= ? AND iid < ? ORDER BY iid
"""


def changed_images(store: Store, folders: Mapping[str, Path]) -> Iterator[Damage]:
    """The frames whose source files are missing or not as they were ingested.

    `folders` are those of the ingested images by domain, that of "" for all other domains; domains
    without one are not compared. Raises RequestError for an unknown domain, and where a folder has
    no image of its domain: those of bags and videos are no files.
    """
    for domain in folders.keys() - {""}:
        store.domain(domain)
    for domain in store.domains:
        folder = folders.get(domain, folders.get(""))
        if folder is not None:
            yield from _changed_in(store, domain, folder)


def _changed_in(store: Store, domain: str, folder: Path) -> Iterator[Damage]:
    missing, has_files = list[Damage](), False
    for start in range(0, len(store.instances), _BLOCK):
        for rgb, depth, expected in store.execute(_FRAMES, [domain, start, start + _BLOCK]):
            names = [name for name in (rgb, depth) if name is not None]
            where = f"{domain}: {' + '.join(names)}"
            try:
                contents = [_content(folder, name) for name in names]
            except FileNotFoundError as error:
                missing.append(Damage(where, f"source file missing: {error.filename}"))
                continue
            except RequestError as error:
                contents = []
                yield Damage(where, first_line(error))
            has_files = True
            if contents and expected not in _checksums(contents):
                yield Damage(where, "source file is not the ingested one: its SHA-256 differs")
    if missing and not has_files:
        raise RequestError(
            f"--source {folder}: has no image of domain {domain}; name the folder that was "
            "ingested (images of bags and videos cannot be compared)"
        )
    yield from missing


def _content(folder: Path, name: str) -> bytes:
    """Read an image file of the folder. Raises FileNotFoundError if there is none."""
    path = folder / name
    if PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
        raise RequestError(f"{name}: lies outside {folder}; it is not read")
    if not path.exists():
        raise FileNotFoundError(None, None, str(path))
    return input_files.read_bytes(path, _MAX_BYTES)


def _checksums(contents: list[bytes]) -> tuple[str, ...]:
    """What column `sha256` may state of the files of a frame."""
    joined = "".join(hashlib.sha256(content).hexdigest() for content in contents)
    checksum = hashlib.sha256(b"".join(contents)).hexdigest()
    return checksum, hashlib.sha256(joined.encode()).hexdigest()
