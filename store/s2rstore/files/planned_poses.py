"""Poses at which real images shall be taken, and their CSV file."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_text

COLUMNS = ("x_m", "y_m", "heading_deg", "room", "expected_gain_m", "reason")
_REQUIRED = ("x_m", "y_m", "heading_deg")
MAX_POSES = 100_000
MAX_VALUE = 1e6
"""Largest number of metres or degrees."""
_MAX_BYTES = 32 << 20


@dataclass(frozen=True, slots=True)
class PlannedPose:
    """A pose in the map frame: metres and degrees in [-180, 180).

    `expected_gain_m` is by how much an image there lowers the mean real error over all candidate
    poses if it removes all reducible error at its pose, NaN where unknown; `room` is empty outside
    all rooms.
    """

    x_m: float
    y_m: float
    heading_deg: float
    room: str = ""
    expected_gain_m: float = math.nan
    reason: str = ""

    @property
    def row(self) -> tuple[float | str | None, ...]:
        """The values of `COLUMNS`; None for an unknown gain."""
        gain = None if math.isnan(self.expected_gain_m) else self.expected_gain_m
        return self.x_m, self.y_m, self.heading_deg, self.room, gain, self.reason


def read_planned_poses(path: Path) -> tuple[PlannedPose, ...]:
    """Read a CSV file with a header; other columns are ignored, as are lines that begin with `#`.

    Only the columns of the pose are required. Raises RequestError, which names file and line.
    """
    text = read_text(path, _MAX_BYTES)
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    reader = csv.DictReader(io.StringIO("\n".join(lines)))
    missing = [name for name in _REQUIRED if name not in (reader.fieldnames or ())]
    if missing:
        raise RequestError(f"{path}: no column {', '.join(missing)}; `s2r collect --out` writes it")
    poses: list[PlannedPose] = []
    try:
        for number, row in enumerate(reader, 1):
            if number > MAX_POSES:
                raise RequestError(f"{path}: more than {MAX_POSES:,} poses")
            poses.append(_parse_row(row, f"{path}: pose {number}"))
    except csv.Error as error:
        raise RequestError(f"{path}: not valid CSV ({error})") from error
    return tuple(poses)


def _parse_row(row: dict[str, str | None], where: str) -> PlannedPose:
    gain = (row.get("expected_gain_m") or "").strip()
    return PlannedPose(
        _number(row, "x_m", where),
        _number(row, "y_m", where),
        _number(row, "heading_deg", where),
        row.get("room") or "",
        _number(row, "expected_gain_m", where) if gain else math.nan,
        row.get("reason") or "",
    )


def _number(row: dict[str, str | None], name: str, where: str) -> float:
    text = (row.get(name) or "").strip()
    try:
        value = float(text)
    except ValueError:
        raise RequestError(f"{where}: {name} is {text[:40]!r}, not a number") from None
    if not math.isfinite(value):
        raise RequestError(f"{where}: {name} is {text[:40]!r}, not a finite number")
    if abs(value) > MAX_VALUE:
        raise RequestError(f"{where}: {name} is {text[:40]!r}, beyond {MAX_VALUE:,.0f}")
    return value


def as_rows(poses: Sequence[PlannedPose]) -> list[tuple[float | str | None, ...]]:
    """The rows of `COLUMNS`, for tables, CSV and JSON."""
    return [pose.row for pose in poses]
