"""Poses at which real images shall be taken, and their CSV file."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_text

COLUMNS = ("x_m", "y_m", "heading_deg", "room", "expected_gain_m", "reason")
_REQUIRED = ("x_m", "y_m", "heading_deg")
STRATUM_COLUMNS = (*_REQUIRED, "room", "stratum")
SAMPLE_COLUMNS = (*STRATUM_COLUMNS, "instances", "candidates")
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


@dataclass(frozen=True, slots=True)
class PoseSample:
    """A pose from each stratum of candidate poses, in the order of the strata.

    candidates: what the candidates are, in one phrase. instances: how many the store had when the
    poses were chosen, so that the images at the poses are those of later ones.
    """

    poses: tuple[PlannedPose, ...]
    instances: int
    candidates: str

    @property
    def rows(self) -> list[tuple[float | str | None, ...]]:
        """The rows of `STRATUM_COLUMNS`."""
        count = len(self.poses)
        return [
            (*pose.row[:4], f"{number} of {count}") for number, pose in enumerate(self.poses, 1)
        ]

    @property
    def file_rows(self) -> list[tuple[float | str | None, ...]]:
        """The rows of `SAMPLE_COLUMNS`."""
        return [(*row, self.instances, self.candidates) for row in self.rows]


def read_planned_poses(path: Path) -> tuple[PlannedPose, ...]:
    """Read a CSV file with a header; other columns are ignored, as are lines that begin with `#`.

    Only the columns of the pose are required. Raises RequestError, which names file and line.
    """
    rows = _read_rows(path, _REQUIRED, "`s2r collect --out` writes it")
    return tuple(_parse_row(row, f"{path}: pose {n}") for n, row in enumerate(rows, 1))


def read_pose_sample(path: Path) -> PoseSample:
    """Read a CSV file of `SAMPLE_COLUMNS`, whose rows may be in any order.

    Raises RequestError, also unless there is one pose of each stratum.
    """
    rows = _read_rows(path, SAMPLE_COLUMNS, "`s2r collect --for evaluation --out` writes it")
    numbers = [re.fullmatch(r"(\d{1,6}) of (\d{1,6})", row["stratum"] or "") for row in rows]
    strata = [(int(found[1]), int(found[2])) for found in numbers if found]
    if not rows or sorted(strata) != [(n, len(rows)) for n in range(1, len(rows) + 1)]:
        raise RequestError(f"{path}: expected one pose of each stratum; take the whole sample")
    same = {(row["instances"] or "", row["candidates"] or "") for row in rows}
    instances, candidates = same.pop()
    if same or not re.fullmatch(r"\d{1,9}", instances):
        raise RequestError(f"{path}: expected one number of instances, and the same candidates")
    poses = [_parse_row(row, f"{path}: stratum {row['stratum']}") for row in rows]
    ordered = sorted(zip(strata, poses, strict=True), key=lambda item: item[0])
    return PoseSample(tuple(pose for _, pose in ordered), int(instances), candidates)


def _read_rows(path: Path, required: Sequence[str], writer: str) -> list[dict[str, str | None]]:
    text = read_text(path, _MAX_BYTES)
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    reader = csv.DictReader(io.StringIO("\n".join(lines)))
    missing = [name for name in required if name not in (reader.fieldnames or ())]
    if missing:
        raise RequestError(f"{path}: no column {', '.join(missing)}; {writer}")
    if len(lines) > MAX_POSES + 1:
        raise RequestError(f"{path}: more than {MAX_POSES:,} poses")
    try:
        return list(reader)
    except csv.Error as error:
        raise RequestError(f"{path}: not valid CSV ({error})") from error


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
