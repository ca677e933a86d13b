"""A fingerprint of all that the stored frames of a scan depend on, found without reading images.

Images count by path, size and time of their last change.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import astuple
from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import numcodecs

from s2rstore.index import schema
from s2rtools.datasets.scan import Scan
from s2rtools.datasets.writing.frame_writing import FramePlace


@runtime_checkable
class TracedSource(Protocol):
    """A `FrameSource` whose changes are found without reading it."""

    def origin(self) -> tuple[Iterable[Path], str] | None:
        """Files or folders that the frame is read from, and a text of all else it depends on.

        None where it does not know its files.
        """


def fingerprint(scan: Scan, places: Mapping[str, FramePlace] | None = None) -> str | None:
    """SHA-256 of the scan's frame size, domains and sources, and of the releases that decode them.

    `places` are those of trajectories that have frames in the store already. None where a source
    does not state its origin.
    """
    digest = hashlib.sha256()
    facts = [domain.facts() for domain in scan.domains.values()]
    releases = schema.VERSION, cv2.__version__, numcodecs.__version__
    _add(digest, releases, os.path.abspath(scan.root), scan.frame, scan.has_poses, facts)
    _add(digest, [(name, astuple(place)) for name, place in sorted((places or {}).items())])
    folders: dict[Path, str] = {}
    for name, records in scan.trajectories.items():
        _add(digest, name, len(records))
        for record in records:
            for domain, source in record.sources.items():
                origin = source.origin() if isinstance(source, TracedSource) else None
                if origin is None:
                    return None
                files, text = origin
                _add(digest, domain, text, *(_state(path, folders) for path in files))
    return digest.hexdigest()


def _add(digest: hashlib._Hash, *values: object) -> None:
    digest.update(repr(values).encode())


def _state(path: Path, folders: dict[Path, str]) -> str:
    """Path, bytes and time of the last change in nanoseconds; of all files of a folder."""
    if path in folders:
        return folders[path]
    try:
        state = path.stat()
    except OSError:
        return f"{os.path.abspath(path)} is missing"
    if not path.is_dir():
        return f"{os.path.abspath(path)} {state.st_size} {state.st_mtime_ns}"
    files = sorted(each for each in path.rglob("*") if not each.is_dir())
    folders[path] = repr([_state(each, folders) for each in files])
    return folders[path]
