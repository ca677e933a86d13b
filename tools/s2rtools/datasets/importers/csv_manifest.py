"""Any paired data, by a CSV manifest: one row per instance and domain.

    trajectory,seq,domain,rgb,depth,x,y,heading[,timestamp,odom_x,odom_y,odom_heading]

`rgb` and `depth` are files relative to the manifest, inside its folder; x and y in metres and
headings in degrees in map coordinates (forward = (cos, sin)); `timestamp` in seconds. Rows of one
(trajectory, seq) must agree on the pose. The header (bounds, rooms, cameras: see `header`) is the
TOML or JSON file of the manifest's name, or the one given with `--header`; its floor plan lies in
the header's folder.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.files.layout import checked_name
from s2rstore.geometry import angles
from s2rtools.datasets import dataset_config
from s2rtools.datasets.csv_rows import read_rows
from s2rtools.datasets.image_decoding import Images
from s2rtools.datasets.path_containment import Containment
from s2rtools.datasets.scan import InputIssue, InstanceRecord, Scan, ScanOptions

REQUIRED = ("trajectory", "seq", "domain", "rgb", "depth", "x", "y", "heading")
_OPTIONAL = ("timestamp", "odom_x", "odom_y", "odom_heading")
_NAMING = REQUIRED[:5]
_POSE_TOLERANCE = 1e-6
_POSE_LIMIT = 1e6

Row = dict[str, str]
Sizes = dict[str, tuple[tuple[int, int], tuple[int, int]]]


def scan(path: Path, options: ScanOptions) -> Scan:
    """Read a manifest. Raises RequestError where it or its header is not as described above."""
    rows = _rows(path)
    where = options.header or _header_of(path)
    data = dataset_config.read(where)
    bounds = dataset_config.bounds(data, where)
    plan = dataset_config.text(data, "floor_plan", "", where)
    inside = Containment(path.parent, options.allow_outside)
    beside = inside.under(where.parent)
    result = Scan(
        name=dataset_config.text(data, "name", path.stem, where),
        root=path.parent,
        frame=options.frame,
        y_down=dataset_config.flag(data, "y_down", False, where),
        bounds=bounds,
        accuracy_scale=dataset_config.scale(data, bounds.diagonal, where),
        domains={},
        rooms=dataset_config.rooms(data, where),
        floor_plan=beside.file(plan, f"{where}: floor_plan") if plan else None,
        trajectories={},
        recorded_at=dataset_config.recorded_at(data, where),
    )
    if isinstance(result.floor_plan, Path) and not result.floor_plan.is_file():
        result.problems.append(InputIssue("missing floor plan", plan))
        result.floor_plan = None
    rows = _complete(result, path, rows)
    names = list(dict.fromkeys(row["domain"] for _, row in rows))
    result.domains = {n: dataset_config.domain(data, n, options.frame, where) for n in names}
    kinds = {domain.kind for domain in result.domains.values()}
    if kinds != {"sim", "real"}:
        raise RequestError(f"{path}: needs rows of a sim and of a real domain (has: {names})")
    sizes = {name: dataset_config.sizes(data, name, where) for name in names}
    _collect(result, path, rows, sizes, options.trajectories, inside)
    result.outside = inside.outside
    return result


def _rows(path: Path) -> list[tuple[int, Row]]:
    """Rows with the numbers of their lines."""
    rows = list(read_rows(path, (*REQUIRED, *_OPTIONAL)))
    if not rows:
        raise RequestError(f"{path}: no rows; the first line names {', '.join(REQUIRED)}")
    missing = [name for name in REQUIRED if name not in rows[0][1]]
    if missing:
        raise RequestError(f"{path}: no column {missing[0]} (needs: {', '.join(REQUIRED)})")
    return rows


def _complete(result: Scan, path: Path, rows: list[tuple[int, Row]]) -> list[tuple[int, Row]]:
    """The rows that say which instance and which files; the others are reported."""
    whole = []
    for number, row in rows:
        blank = [name for name in _NAMING if not row[name]]
        if blank:
            where = f"{path.name}:{number}"
            result.problems.append(InputIssue("incomplete row", where, f"no {blank[0]}"))
        else:
            whole.append((number, row))
    return whole


def _header_of(path: Path) -> Path:
    for suffix in (".toml", ".json"):
        if path.with_suffix(suffix).is_file():
            return path.with_suffix(suffix)
    raise RequestError(f"{path.with_suffix('.toml')}: missing; give the header with --header FILE")


def _collect(
    result: Scan,
    path: Path,
    rows: list[tuple[int, Row]],
    sizes: Sizes,
    wanted: tuple[str, ...],
    inside: Containment,
) -> None:
    views: dict[str, dict[int, dict[str, tuple[int, Row]]]] = {}
    for number, row in rows:
        where = f"{path.name}:{number}"
        seq = _integer(row["seq"])
        if seq is None:
            result.problems.append(InputIssue("bad seq", where, row["seq"]))
            continue
        group = views.setdefault(row["trajectory"], {}).setdefault(seq, {})
        if row["domain"] in group:
            detail = f"{row['trajectory']} {seq} {row['domain']}"
            result.problems.append(InputIssue("duplicate row", where, detail))
            continue
        group[row["domain"]] = (number, row)
    for name in wanted:
        if name not in views:
            raise RequestError(f"--trajectory {name}: not in {path} (has: {', '.join(views)})")
    for trajectory in wanted or sorted(views):
        checked_name(trajectory, "trajectory")
        sightings = []
        for seq in sorted(views[trajectory]):
            sighting = _sighting(result, path, views[trajectory][seq], sizes, inside)
            if sighting is not None:
                sightings.append(sighting)
        if sightings:
            result.trajectories[trajectory] = sightings
        else:
            result.problems.append(InputIssue("empty trajectory", trajectory, "no usable pair"))


def _sighting(
    result: Scan,
    path: Path,
    views: dict[str, tuple[int, Row]],
    sizes: Sizes,
    inside: Containment,
) -> InstanceRecord | None:
    number, first = next(iter(views.values()))
    where = f"{path.name}:{number}"
    absent = [name for name in sizes if name not in views]
    if absent:
        result.problems.append(InputIssue("unmatched pair", where, f"no row of {absent[0]}"))
        return None
    pose = _pose(first)
    if not all(abs(value) <= _POSE_LIMIT for value in pose):
        result.problems.append(InputIssue("bad pose", where))
        return None
    for other, row in views.values():
        if any(abs(a - b) > _POSE_TOLERANCE for a, b in zip(pose, _pose(row), strict=True)):
            result.problems.append(InputIssue("poses disagree", f"{path.name}:{other}"))
            return None
    images = {}
    for domain in sizes:
        line, row = views[domain]
        rgb, depth = (inside.file(row[key], f"{path}:{line}: {key}") for key in ("rgb", "depth"))
        for file in (rgb, depth):
            if len(file.name) > 255 or not file.is_file():
                result.problems.append(InputIssue("missing image", result.relative(file)))
                return None
        images[domain] = Images(rgb, depth, *sizes[domain])
    real = next(row for name, (_, row) in views.items() if result.domains[name].kind == "real")
    odometry = [_float(real.get(f"odom_{name}")) for name in ("x", "y", "heading")]
    known = all(math.isfinite(value) for value in odometry)
    stamp = _float(real.get("timestamp"))
    return InstanceRecord(
        x=pose[0],
        y=pose[1],
        heading=_wrapped(pose[2]),
        images=images,
        odometry=(odometry[0], odometry[1], _wrapped(odometry[2])) if known else None,
        timestamp=stamp if math.isfinite(stamp) else None,
    )


def _pose(row: dict[str, Any]) -> tuple[float, float, float]:
    return _float(row["x"]), _float(row["y"]), _float(row["heading"])


def _wrapped(degrees: float) -> float:
    return math.radians(angles.wrap_degrees(degrees))


def _float(text: str | None) -> float:
    try:
        return float(text) if text else math.nan
    except ValueError:
        return math.nan


def _integer(text: str) -> int | None:
    try:
        return int(text)
    except ValueError:
        return None
