"""What `s2r precompute` is computing in a store, for applications that show it.

A small file that is replaced once a second at most, and removed at the end. It is information only:
the compute lock tells whether a process computes.
"""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import msgspec

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, process_identity
from s2rstore.files.documents import decode_json
from s2rstore.files.process_identity import ProcessIdentity
from s2rstore.files.store_files import StoreFiles

FILE = f"{layout.LEDGER}/progress.json"
_BYTES = 4096
_SILENT_SECONDS = 600.0
"""An older file of another host counts as that of a killed process."""


class ComputeProgress(msgspec.Struct, frozen=True):
    """What a process computes: `stage` of its work, of which `done` of `total` steps are finished.

    `left`: seconds until everything is computed, None as long as that is unknown. `written`: the
    time, seconds since 1970. A total of 0 is unknown.
    """

    process: ProcessIdentity
    stage: Annotated[str, msgspec.Meta(max_length=200)]
    done: Annotated[int, msgspec.Meta(ge=0)]
    total: Annotated[int, msgspec.Meta(ge=0)]
    left: Annotated[float, msgspec.Meta(ge=0)] | None
    written: float

    @property
    def text(self) -> str:
        """`computing vanilla: harm 40/100, about 2 min left`."""
        text = f"computing {self.stage}" + (f" {self.done}/{self.total}" if self.total else "")
        return text if self.left is None else f"{text}, about {_rounded(self.left)} left"


def _rounded(seconds: float) -> str:
    if seconds < 55:
        return f"{max(5, 5 * round(seconds / 5))} s"
    return f"{round(seconds / 60)} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def write(root: Path, stage: str, done: int, total: int, left: float | None) -> None:
    """Replace the file; a disk that cannot be written is no error."""
    process = process_identity.this_process()
    progress = ComputeProgress(process, stage[:200], done, total, left, time.time())
    with suppress(OSError, RequestError):
        atomic_writes.write(root, FILE, msgspec.json.encode(progress), durable=False)


def remove(root: Path) -> None:
    """Remove the file, if there is one."""
    with suppress(OSError, RequestError):
        atomic_writes.remove(root, FILE)


def read(files: StoreFiles) -> ComputeProgress | None:
    """What a process computes now; None where none does, or where the file cannot be read."""
    try:
        progress = decode_json(files.read(FILE, _BYTES), ComputeProgress, FILE)
    except (OSError, RequestError):
        return None
    if progress.process.host == process_identity.host_name():
        has_ended = process_identity.has_ended(progress.process)
    else:
        has_ended = time.time() - progress.written > _SILENT_SECONDS
    return None if has_ended else progress
