"""Import any paired data by a CSV manifest with one row per instance and domain.

    trajectory,seq,domain,rgb,depth,x,y,heading[,timestamp,odom_x,odom_y,odom_heading]

`rgb` and `depth` are files relative to the manifest, inside its folder; x and y in metres and
headings in degrees in map coordinates (forward = (cos, sin)); `timestamp` in seconds. `seq` orders
the instances of a trajectory and is kept. Rows of one (trajectory, seq) must agree on the pose.
Every instance of a trajectory needs a row in each domain that the trajectory has rows of; another
trajectory may have other domains.
The configuration (bounds, rooms, cameras: see `dataset_config`) is the TOML or JSON file with the
manifest's name, or the file that `--header` names; its floor plan lies in the configuration's
folder.
"""

from __future__ import annotations

import math
import os
from array import array
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rstore.lazy_sequence import LazySequence, RowFile
from s2rstore.records import Side
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.csv_rows import missing_column, parse_float, read_rows
from s2rtools.datasets.dataset_config import DatasetConfig, Size
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recordings.image_frame_source import source_of_files
from s2rtools.datasets.scan import InstanceRecord, Scan, ScanOptions

REQUIRED = ("trajectory", "seq", "domain", "rgb", "depth", "x", "y", "heading")
_OPTIONAL = ("timestamp", "odom_x", "odom_y", "odom_heading")
_IDENTIFYING = REQUIRED[:5]
_POSE_TOLERANCE = 1e-6
_POSE_LIMIT = 1e6
_MAX_SHOWN = 40
_MAX_SEQ = 2**31 - 1
"""Largest number of an instance that the index holds."""

Row = dict[str, str]
NumberedRow = tuple[int, Row]
"""The number of the row's last line, and its values."""
Sizes = dict[str, tuple[Size, Size]]


def scan(path: Path, options: ScanOptions) -> Scan:
    """Read a manifest and its configuration. Raises RequestError if either is malformed."""
    rows = _Rows(path)
    header = options.header or next(
        (path.with_suffix(s) for s in (".toml", ".json") if path.with_suffix(s).is_file()), None
    )
    if header is None:
        raise RequestError(
            f"{path.with_suffix('.toml')}: missing; it states bounds, rooms and cameras; name "
            "another file by --header FILE"
        )
    config = DatasetConfig(header, name=path.stem, y_down=False)
    containment = PathContainment(path.parent, options.allow_outside)
    result = config.empty_scan(path.parent, options.frame, containment)
    result.recorded_at = {name: str(date) for name, date in config.table.recorded_at.items()}
    result.issues += rows.issues
    chosen = options.choose_trajectories(rows.trajectories, path)
    domains = {trajectory: rows.domains_of(trajectory) for trajectory in chosen}
    names = [name for name in rows.domains if any(name in each for each in domains.values())]
    result.domains = {name: config.domain(name, options.frame) for name in names}
    for trajectory in chosen:
        sizes = {name: config.image_sizes(name) for name in domains[trajectory]}
        _add_trajectory(result, trajectory, rows, sizes, containment)
    return result


class _RowFile(RowFile):
    """The values of a manifest's rows and the numbers of their last lines."""

    def instance(self, rows: Iterable[int]) -> dict[str, NumberedRow]:
        """The rows of one instance by domain."""
        by_domain: dict[str, NumberedRow] = {}
        for row in rows:
            number, *values = self[row]
            named = dict(zip((*REQUIRED, *_OPTIONAL), values, strict=True))
            by_domain[named["domain"]] = number, named
        return by_domain


class _Rows:
    """The rows of a manifest in a temporary file; in memory are the numbers that sort them.

    `domains` are their names in order of the first row. `issues` are those of rows that do not name
    their instance and files, and of repeated rows: of rows of one trajectory, seq and domain the
    first one counts.
    """

    def __init__(self, path: Path) -> None:
        """Raises RequestError if there is no row or a column is missing."""
        self.path = path
        self.file = _RowFile()
        self._trajectories: dict[str, int] = {}
        self.domains: dict[str, int] = {}
        self.issues: list[InputIssue] = []
        self._keys = tuple(array(kind) for kind in ("i", "q", "i"))
        empty = True
        for number, row in read_rows(path, (*REQUIRED, *_OPTIONAL), self._check_names):
            empty = False
            self._add(number, row)
        if empty:
            raise RequestError(f"{path}: no rows; the first line names {', '.join(REQUIRED)}")
        self._sort()

    def _check_names(self, names: list[str]) -> None:
        if missing := [name for name in REQUIRED if name not in names]:
            raise missing_column(self.path, missing[0], names, ", ".join(REQUIRED))

    def _add(self, number: int, row: Row) -> None:
        where = f"{self.path.name}:{number}"
        if blank := [name for name in _IDENTIFYING if not row[name]]:
            self.issues.append(InputIssue("incomplete row", where, f"no {blank[0]}"))
            return
        domain = self.domains.setdefault(row["domain"], len(self.domains))
        try:
            seq = int(row["seq"])
            if not 0 <= seq <= _MAX_SEQ:
                raise ValueError(f"{seq} is out of range")
        except ValueError:
            detail = f"{row['seq'][:_MAX_SHOWN]}: not a whole number from 0 to {_MAX_SEQ}"
            self.issues.append(InputIssue("bad seq", where, detail))
            return
        trajectory = self._trajectories.setdefault(row["trajectory"], len(self._trajectories))
        for column, value in zip(self._keys, (trajectory, seq, domain), strict=True):
            column.append(value)
        self.file.append(number, *(row.get(name, "") for name in (*REQUIRED, *_OPTIONAL)))

    def _sort(self) -> None:
        """Put the rows of each instance together, without repeated ones, which are reported."""
        trajectory, seq, domain = (np.asarray(column) for column in self._keys)
        order = np.lexsort((domain, seq, trajectory)).astype(np.int32)
        repeated = np.zeros(len(order), dtype=bool)
        repeated[1:] = ~_changes(order, trajectory, seq, domain)
        for row in np.sort(order[repeated]).tolist():
            ((number, values),) = self.file.instance([row]).values()
            detail = f"{values['trajectory']} {int(values['seq'])} {values['domain']}"
            place = f"{self.path.name}:{number}"
            self.issues.append(InputIssue("duplicate row", place, detail))
        kept = np.sort(order[~repeated])
        self._order = kept[np.lexsort((seq[kept], trajectory[kept]))]
        starts = np.flatnonzero(_changes(self._order, trajectory, seq)) + 1
        self._bounds = np.concatenate([[0], starts, [len(kept)]]).astype(np.int32)

    @property
    def trajectories(self) -> list[str]:
        """The names of the trajectories in their order."""
        return sorted(self._trajectories)

    def domains_of(self, trajectory: str) -> list[str]:
        """The domains that a trajectory has rows of, in order of the first row of each."""
        codes, domains = (np.asarray(self._keys[place]) for place in (0, 2))
        used = set(np.unique(domains[codes == self._trajectories[trajectory]]).tolist())
        return [name for name, code in self.domains.items() if code in used]

    def instances(self, trajectory: str) -> Iterator[list[int]]:
        """The rows of each instance of a trajectory."""
        code, bounds = self._trajectories[trajectory], self._bounds
        codes = np.asarray(self._keys[0])[self._order[bounds[:-1]]]
        first, last = np.searchsorted(codes, [code, code + 1]).tolist()
        return (self._order[bounds[k] : bounds[k + 1]].tolist() for k in range(first, last))


def _changes(order: NDArray[np.int32], *columns: NDArray[Any]) -> NDArray[np.bool_]:
    """(n - 1,) whether a row in `order` differs in any column from the one before it."""
    changes = np.zeros(max(len(order) - 1, 0), dtype=bool)
    for column in columns:
        changes |= column[order[1:]] != column[order[:-1]]
    return changes


def _add_trajectory(
    result: Scan,
    trajectory: str,
    rows: _Rows,
    sizes: Sizes,
    containment: PathContainment,
) -> None:
    """Add the usable instances of a trajectory; their records are made again when they are read."""
    usable, manifest = array("i"), rows.file
    for numbers in rows.instances(trajectory):
        if _is_usable(result, rows.path, manifest.instance(numbers), sizes, containment):
            usable.extend(numbers)
    kinds = {name: domain.kind for name, domain in result.domains.items()}
    folder, each = containment.folder, len(sizes)

    def record(number: int) -> InstanceRecord:
        by_domain = manifest.instance(usable[each * number : each * (number + 1)])
        return _record(by_domain, sizes, kinds, folder)

    result.add_trajectory(trajectory, LazySequence(len(usable) // each, record))


def _is_usable(
    result: Scan,
    path: Path,
    by_domain: dict[str, NumberedRow],
    sizes: Sizes,
    containment: PathContainment,
) -> bool:
    """Whether an instance has a row in every domain of its trajectory, one pose and all files.

    Reports it if not.
    """
    number, first = next(iter(by_domain.values()))
    where = f"{path.name}:{number}"
    missing = [name for name in sizes if name not in by_domain]
    if missing:
        result.issues.append(InputIssue("unmatched pair", where, f"no row of {missing[0]}"))
        return False
    pose = _pose(first)
    if not all(abs(value) <= _POSE_LIMIT for value in pose):
        result.issues.append(InputIssue("bad pose", where))
        return False
    for other, row in by_domain.values():
        if any(abs(a - b) > _POSE_TOLERANCE for a, b in zip(pose, _pose(row), strict=True)):
            result.issues.append(InputIssue("poses disagree", f"{path.name}:{other}"))
            return False
    for domain in sizes:
        line, row = by_domain[domain]
        for key in ("rgb", "depth"):
            if containment.find_file(row[key], f"{path}:{line}: {key}") is None:
                result.issues.append(InputIssue("missing image", row[key]))
                return False
    return True


def _record(
    by_domain: dict[str, NumberedRow], sizes: Sizes, kinds: dict[str, Side], folder: Path
) -> InstanceRecord:
    """The record of a usable instance."""
    first = next(iter(by_domain.values()))[1]
    pose = _pose(first)
    sources = {}
    for domain in sizes:
        _, row = by_domain[domain]
        names = os.path.normpath(row["rgb"]), os.path.normpath(row["depth"])
        sources[domain] = source_of_files(folder, *names, sizes[domain])
    recorded = next((row for name, (_, row) in by_domain.items() if kinds[name] == "real"), first)
    x, y, heading, timestamp = (
        parse_float(recorded.get(name))
        for name in ("odom_x", "odom_y", "odom_heading", "timestamp")
    )
    has_odometry = math.isfinite(x) and math.isfinite(y) and math.isfinite(heading)
    return InstanceRecord(
        x=pose[0],
        y=pose[1],
        heading=_heading(pose[2]),
        sources=sources,
        odometry=(x, y, _heading(heading)) if has_odometry else None,
        timestamp=timestamp if math.isfinite(timestamp) else None,
        seq=int(first["seq"]),
    )


def _pose(row: Row) -> list[float]:
    return [parse_float(row[name]) for name in ("x", "y", "heading")]


def _heading(degrees: float) -> float:
    """Radians in [-pi, pi)."""
    return math.radians(angles.wrap_degrees(degrees))
