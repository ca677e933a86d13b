"""Import any paired data by a CSV manifest with one row per instance and domain.

    trajectory,seq,domain,rgb,depth,x,y,heading[,timestamp,odom_x,odom_y,odom_heading]

`rgb` and `depth` are files relative to the manifest, inside its folder; x and y in metres and
headings in degrees in map coordinates (forward = (cos, sin)); `timestamp` in seconds. Rows of one
(trajectory, seq) must agree on the pose. The configuration (bounds, rooms, cameras: see
`dataset_config`) is the TOML or JSON file with the manifest's name, or the file that `--header`
names; its floor plan lies in the configuration's folder.
"""

from __future__ import annotations

import math
from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.geometry import angles
from s2rtools.datasets.csv_rows import parse_float, read_rows
from s2rtools.datasets.dataset_config import DatasetConfig, Size
from s2rtools.datasets.image_decoding import ImageFiles
from s2rtools.datasets.path_containment import PathContainment
from s2rtools.datasets.scan import InputIssue, InstanceRecord, Scan, ScanOptions

REQUIRED = ("trajectory", "seq", "domain", "rgb", "depth", "x", "y", "heading")
_OPTIONAL = ("timestamp", "odom_x", "odom_y", "odom_heading")
_IDENTIFYING = REQUIRED[:5]
_POSE_TOLERANCE = 1e-6
_POSE_LIMIT = 1e6

Row = dict[str, str]
NumberedRow = tuple[int, Row]
"""The number of the row's last line, and its values."""
Sizes = dict[str, tuple[Size, Size]]


def scan(path: Path, options: ScanOptions) -> Scan:
    """Read a manifest and its configuration. Raises RequestError if either is malformed."""
    rows = list(read_rows(path, (*REQUIRED, *_OPTIONAL)))
    if not rows:
        raise RequestError(f"{path}: no rows; the first line names {', '.join(REQUIRED)}")
    missing = [name for name in REQUIRED if name not in rows[0][1]]
    if missing:
        raise RequestError(f"{path}: no column {missing[0]} (needs: {', '.join(REQUIRED)})")
    header = options.header or next(
        (path.with_suffix(s) for s in (".toml", ".json") if path.with_suffix(s).is_file()), None
    )
    if header is None:
        raise RequestError(f"{path.with_suffix('.toml')}: missing; name the file by --header FILE")
    config = DatasetConfig(header, name=path.stem, y_down=False)
    containment = PathContainment(path.parent, options.allow_outside)
    result = config.empty_scan(path.parent, options.frame, containment)
    result.recorded_at = {name: str(date) for name, date in config.table.recorded_at.items()}
    if plan := config.table.floor_plan:
        folder = containment.for_folder(config.path.parent)
        file = folder.resolve(plan, f"{config.path}: floor_plan")
        if file.is_file():
            result.floor_plan = file
        else:
            result.issues.append(InputIssue("missing floor plan", plan))
    rows = _complete_rows(result, path, rows)
    names = list(dict.fromkeys(row["domain"] for _, row in rows))
    result.domains = {name: config.domain(name, options.frame) for name in names}
    kinds = {domain.kind for domain in result.domains.values()}
    if kinds != {"sim", "real"}:
        raise RequestError(f"{path}: needs rows of a sim and of a real domain (has: {names})")
    sizes = {name: config.image_sizes(name) for name in names}
    _collect(result, path, rows, sizes, options, containment)
    return result


def _complete_rows(result: Scan, path: Path, rows: list[NumberedRow]) -> list[NumberedRow]:
    """The rows that name their instance and files; the others are reported."""
    complete = []
    for number, row in rows:
        blank = [name for name in _IDENTIFYING if not row[name]]
        if blank:
            where = f"{path.name}:{number}"
            result.issues.append(InputIssue("incomplete row", where, f"no {blank[0]}"))
        else:
            complete.append((number, row))
    return complete


def _collect(
    result: Scan,
    path: Path,
    rows: list[NumberedRow],
    sizes: Sizes,
    options: ScanOptions,
    containment: PathContainment,
) -> None:
    """Group the rows by trajectory, seq and domain, and add the usable instances to the scan."""
    instances: dict[str, dict[int, dict[str, NumberedRow]]] = {}
    for number, row in rows:
        where = f"{path.name}:{number}"
        try:
            seq = int(row["seq"])
        except ValueError:
            result.issues.append(InputIssue("bad seq", where, row["seq"]))
            continue
        by_domain = instances.setdefault(row["trajectory"], {}).setdefault(seq, {})
        if row["domain"] in by_domain:
            detail = f"{row['trajectory']} {seq} {row['domain']}"
            result.issues.append(InputIssue("duplicate row", where, detail))
            continue
        by_domain[row["domain"]] = (number, row)
    for trajectory in options.choose_trajectories(sorted(instances), path):
        records = (
            _instance_record(result, path, by_domain, sizes, containment)
            for _, by_domain in sorted(instances[trajectory].items())
        )
        result.add_trajectory(trajectory, records)


def _instance_record(
    result: Scan,
    path: Path,
    by_domain: dict[str, NumberedRow],
    sizes: Sizes,
    containment: PathContainment,
) -> InstanceRecord | None:
    number, first = next(iter(by_domain.values()))
    where = f"{path.name}:{number}"
    missing = [name for name in sizes if name not in by_domain]
    if missing:
        result.issues.append(InputIssue("unmatched pair", where, f"no row of {missing[0]}"))
        return None
    pose = _pose(first)
    if not all(abs(value) <= _POSE_LIMIT for value in pose):
        result.issues.append(InputIssue("bad pose", where))
        return None
    for other, row in by_domain.values():
        if any(abs(a - b) > _POSE_TOLERANCE for a, b in zip(pose, _pose(row), strict=True)):
            result.issues.append(InputIssue("poses disagree", f"{path.name}:{other}"))
            return None
    sources = {}
    for domain in sizes:
        line, row = by_domain[domain]
        rgb, depth = (
            containment.resolve(row[key], f"{path}:{line}: {key}") for key in ("rgb", "depth")
        )
        for file in (rgb, depth):
            if len(file.name) > 255 or not file.is_file():
                result.issues.append(InputIssue("missing image", result.relative(file)))
                return None
        sources[domain] = ImageFiles(rgb, depth, *sizes[domain])
    real = next(row for name, (_, row) in by_domain.items() if result.domains[name].kind == "real")
    x, y, heading, timestamp = (
        parse_float(real.get(name)) for name in ("odom_x", "odom_y", "odom_heading", "timestamp")
    )
    has_odometry = math.isfinite(x) and math.isfinite(y) and math.isfinite(heading)
    return InstanceRecord(
        x=pose[0],
        y=pose[1],
        heading=_heading(pose[2]),
        sources=sources,
        odometry=(x, y, _heading(heading)) if has_odometry else None,
        timestamp=timestamp if math.isfinite(timestamp) else None,
    )


def _pose(row: Row) -> list[float]:
    return [parse_float(row[name]) for name in ("x", "y", "heading")]


def _heading(degrees: float) -> float:
    """Radians in [-pi, pi)."""
    return math.radians(angles.wrap_degrees(degrees))
