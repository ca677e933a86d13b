"""Write the history of nightly gaps: the file is replaced, so that readers never see a part."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from s2rstore.errors import RequestError, first_line
from s2rstore.files import atomic_writes
from s2rstore.gap_history import reader
from s2rstore.gap_history.reader import Night

Check = Callable[[], None]


def append(
    path: Path, night: Night, report: str | None = None, check: Check = lambda: None
) -> None:
    """Add a night durably; `report` is the JSON text of a new measurement.

    Raises RequestError on failure. The caller holds the lock; `check` of its lease is called
    directly before the file is replaced.
    """
    earlier = reader.lines(path) if path.exists() else []
    _write(path, [*earlier, reader.line_of(night, report)], check)


def withdraw_night(
    path: Path, name: str, night: datetime.date, now: str, check: Check = lambda: None
) -> None:
    """Mark the records of a night as withdrawn at the time `now`, as in `append`."""
    changed = []
    for line in reader.lines(path):
        row = json.loads(line)
        if (row["name"], row["night"]) == (name, str(night)) and not row["withdrawn_at"]:
            row.pop("crc32")
            line = reader.checked_line(json.dumps(row | {"withdrawn_at": now}).encode())
        changed.append(line)
    _write(path, changed, check)


def _write(path: Path, lines: Sequence[bytes], check: Check) -> None:
    reader.refuse_link(path)
    try:
        for left in path.parent.glob(f".{path.name}.{'[0-9a-f]' * 16}{atomic_writes.PARTIAL}"):
            left.unlink(missing_ok=True)
        atomic_writes.write_file(path, b"".join(lines), check)
        path.chmod(0o644)
    except OSError as error:
        raise RequestError(f"{path}: cannot be written ({first_line(error)})") from error
