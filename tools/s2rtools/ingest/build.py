"""From a scan to a published store, built beside and renamed: nothing half-ingested is seen."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from s2rstore import arrays, layout, stats
from s2rstore.errors import RequestError
from s2rstore.geometry.rooms import room_codes
from s2rstore.geometry.trajectory import curvature
from s2rstore.ledger import Ledger
from s2rstore.records import Domain
from s2rstore.writer import Draft, edit
from s2rtools.ingest.ahead import ahead
from s2rtools.ingest.images import View, decode
from s2rtools.ingest.scan import Problem, Scan, Sighting

SHARD_ROWS = 64
_PLAN_PIXELS = 1056

Progress = Callable[[int], None]


@dataclass(frozen=True, slots=True)
class _Facts:
    """What is kept of a view once its pixels are written."""

    sha256: str
    valid_fraction: float


Trajectories = dict[str, list[tuple[Sighting, dict[str, _Facts]]]]


def build(scan: Scan, target: Path, command: str, strict: bool, progress: Progress) -> None:
    """Decode, check and store a scan as a new store at `target`.

    Instances with an unusable view are left out and reported in `scan.problems`. Raises
    RequestError where `target` exists, where nothing is usable, or with `strict` where anything
    was reported. `progress` is called with the number of finished views.
    """
    if target.exists():
        raise RequestError(f"{target}: exists; choose another --store, or remove it")
    _report_outside(scan)
    _refuse(scan, strict)
    beside = target.with_name(f".{target.name}.building-{os.getpid()}")
    shutil.rmtree(beside, ignore_errors=True)
    try:
        beside.mkdir(parents=True)
        kept = {
            name: list(_write_trajectory(scan, beside, name, rows, progress))
            for name, rows in scan.trajectories.items()
        }
        kept = {name: rows for name, rows in kept.items() if rows}
        if not kept:
            scan.problems.append(Problem("empty data set", str(scan.root), "no usable pair"))
        plan = _write_floor_plan(scan, beside)
        _refuse(scan, strict)
        with edit(beside) as draft:
            _write_index(draft, scan, kept, plan, command)
        beside.rename(target)
        layout.sync_folder(target.parent)
    except OSError as error:
        raise RequestError(f"{target}: cannot be written ({error.strerror})") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _refuse(scan: Scan, strict: bool) -> None:
    fatal = [p for p in scan.problems if p.kind == "empty data set"] or not scan.trajectories
    if fatal or (strict and scan.problems):
        first = scan.problems[0] if scan.problems else Problem("empty data set", str(scan.root))
        more = f" and {len(scan.problems) - 1} more" if len(scan.problems) > 1 else ""
        raise RequestError(
            f"{first.file}: {first.kind} {first.detail}".rstrip() + f"{more}; nothing was ingested"
        )


def _write_trajectory(
    scan: Scan, root: Path, name: str, sightings: list[Sighting], progress: Progress
) -> Iterator[tuple[Sighting, dict[str, _Facts]]]:
    """Write the usable instances of one trajectory; two passes keep memory small.

    The first pass checks every view, so that the arrays get their final length at once.
    """
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        usable = _usable(scan, pool, sightings, progress)
        if not usable:
            return
        facts: dict[str, list[_Facts]] = {}
        for domain in scan.domains.values():
            views = ahead(pool, partial(_decoded, scan, domain), usable)
            facts[domain.domain] = list(_write_frames(root, name, domain, views, len(usable)))
            progress(len(usable))
    for row, sighting in enumerate(usable):
        yield sighting, {domain: facts[domain][row] for domain in facts}


def _usable(
    scan: Scan, pool: Executor, sightings: list[Sighting], progress: Progress
) -> list[Sighting]:
    """The sightings whose views all decode to one type of depth per domain."""
    good: list[tuple[Sighting, dict[str, str]]] = []
    for sighting, found in zip(
        sightings, ahead(pool, partial(_depth_types, scan), sightings), strict=True
    ):
        progress(len(sighting.images))
        bad = [problem for problem in found.values() if isinstance(problem, Problem)]
        scan.problems += bad
        if not bad:
            good.append((sighting, {d: t for d, t in found.items() if isinstance(t, str)}))
    usual = {
        domain: Counter(types[domain] for _, types in good).most_common(1)[0][0]
        for domain in (scan.domains if good else ())
    }
    usable = []
    for sighting, types in good:
        odd = [domain for domain in usual if types[domain] != usual[domain]]
        for domain in odd:
            file = scan.relative(sighting.images[domain].depth)
            detail = f"{types[domain]}, the others are {usual[domain]}"
            scan.problems.append(Problem("mixed depth types", file, detail))
        if not odd:
            usable.append(sighting)
    return usable


def _depth_types(scan: Scan, sighting: Sighting) -> dict[str, str | Problem]:
    """Per domain the type of the depth values, or what is wrong with the view."""
    found: dict[str, str | Problem] = {}
    for name, images in sighting.images.items():
        view = decode(scan, scan.domains[name], images)
        found[name] = view if isinstance(view, Problem) else str(view.depth.dtype)
    return found


def _report_outside(scan: Scan) -> None:
    edges = scan.bounds
    for rows in scan.trajectories.values():
        for row in rows:
            if not (edges.x0 <= row.x <= edges.x1 and edges.y0 <= row.y <= edges.y1):
                file = scan.relative(next(iter(row.images.values())).rgb)
                detail = f"({row.x:g}, {row.y:g}); kept"
                scan.problems.append(Problem("pose outside the bounds", file, detail))


def _decoded(scan: Scan, domain: Domain, sighting: Sighting) -> View:
    view = decode(scan, domain, sighting.images[domain.domain])
    if isinstance(view, Problem):
        raise RequestError(f"{view.file}: changed while it was read; ingest again")
    return view


def _write_frames(
    root: Path, trajectory: str, domain: Domain, views: Iterator[View], count: int
) -> Iterator[_Facts]:
    ledger = Ledger(root)
    folder = Path(layout.FRAMES, domain.domain, trajectory)
    shard = 0
    while block := list(islice(views, SHARD_ROWS)):
        images = {
            "rgb": np.stack([view.rgb for view in block]),
            "depth": np.stack([view.depth for view in block]),
        }
        for image, rows in images.items():
            relative = folder / image
            if shard == 0:
                plan = arrays.plan(count, rows.shape[1:], str(rows.dtype), SHARD_ROWS)
                arrays.create(root / relative, plan)
            file = arrays.write_shard(root / relative, shard, rows)
            key = f"frames:{domain.domain}:{trajectory}:{image}:{shard}"
            ledger.add(key, [(file.relative_to(root).as_posix(), len(rows))])
        shard += 1
        yield from (_Facts(view.sha256, view.valid_fraction) for view in block)


def _write_floor_plan(scan: Scan, root: Path) -> str | None:
    if scan.floor_plan is None:
        return None
    picture = cv2.imread(str(scan.floor_plan), cv2.IMREAD_COLOR)
    if picture is None:
        scan.problems.append(Problem("unreadable floor plan", scan.relative(scan.floor_plan)))
        return None
    scale = min(1.0, _PLAN_PIXELS / max(picture.shape[:2]))
    size = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    (root / layout.ASSETS).mkdir()
    name = f"{layout.ASSETS}/floor_plan.png"
    cv2.imwrite(str(root / name), small)
    return name


def _write_index(
    draft: Draft, scan: Scan, kept: Trajectories, plan: str | None, command: str
) -> None:
    names = sorted(kept)
    rows = [(name, seq, *row) for name in names for seq, row in enumerate(kept[name])]
    sightings = [sighting for _, _, sighting, _ in rows]
    draft.insert_row("dataset", _dataset_row(scan, rows, plan))
    for name in names:
        draft.insert_row(
            "trajectory",
            {"trajectory": name, "recorded_at": scan.recorded_at.get(name),
             "instances": len(kept[name])},
        )  # fmt: skip
    for room in scan.rooms:
        draft.insert_row("room", asdict(room))
    for domain in scan.domains.values():
        draft.insert_row("domain", _domain_row(domain))
    draft.insert("instance", _instance_columns(scan, rows))
    for name in scan.domains:
        draft.insert(
            "frame",
            {
                "iid": np.arange(len(rows), dtype=np.int32),
                "domain": np.full(len(rows), name, dtype=object),
                "rgb_path": [scan.relative(s.images[name].rgb) for s in sightings],
                "depth_path": [scan.relative(s.images[name].depth) for s in sightings],
                "sha256": [facts[name].sha256 for *_, facts in rows],
                "valid_depth_fraction": [facts[name].valid_fraction for *_, facts in rows],
            },
        )
    problems: dict[str, int] = {}
    for problem in scan.problems:
        problems[problem.kind] = problems.get(problem.kind, 0) + 1
    draft.note(
        "dataset",
        {"command": command, "ingested_at": datetime.now(UTC).isoformat(timespec="seconds"),
         "problems": problems},
    )  # fmt: skip
    draft.note("statistics", {"bootstrap": asdict(stats.BOOTSTRAP)})


def _dataset_row(scan: Scan, rows: list[Any], plan: str | None) -> dict[str, Any]:
    facts = {
        "frame": scan.frame,
        "bounds": asdict(scan.bounds),
        "rooms": [asdict(room) for room in scan.rooms],
        "domains": [asdict(domain) for domain in scan.domains.values()],
        "rows": [
            (name, seq, s.x, s.y, s.heading, {d: f.sha256 for d, f in facts.items()})
            for name, seq, s, facts in rows
        ],
    }
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    edges = {f"bounds_{name}": value for name, value in asdict(scan.bounds).items()}
    return {
        "name": scan.name,
        "hash": digest,
        **edges,
        "y_down": scan.y_down,
        "floor_plan": plan,
        "accuracy_scale": scan.accuracy_scale,
        "frame_height": scan.frame[0],
        "frame_width": scan.frame[1],
    }


def _domain_row(domain: Domain) -> dict[str, Any]:
    row = {key: value for key, value in asdict(domain).items() if not isinstance(value, dict)}
    for image in ("rgb", "depth"):
        row |= {f"{image}_{name}": v for name, v in asdict(getattr(domain, image)).items()}
    return {**row, "source": domain.sources}


def _instance_columns(scan: Scan, rows: list[Any]) -> dict[str, Any]:
    sightings: list[Sighting] = [sighting for _, _, sighting, _ in rows]
    names = np.array([name for name, *_ in rows], dtype=object)
    x, y, heading = (np.array([getattr(s, k) for s in sightings]) for k in ("x", "y", "heading"))
    bend = np.zeros(len(rows))
    for name in dict.fromkeys(names):
        bend[names == name] = curvature(heading[names == name])
    room_names = list(dict.fromkeys(room.room for room in scan.rooms))
    codes = room_codes(x, y, scan.rooms, room_names)
    missing = (np.nan, np.nan, np.nan)
    odometry = np.array([s.odometry or missing for s in sightings], dtype=np.float64)
    return {
        "iid": np.arange(len(rows), dtype=np.int32),
        "trajectory": names,
        "seq": np.array([seq for _, seq, *_ in rows], dtype=np.int32),
        "x": x,
        "y": y,
        "heading": heading,
        "room": [room_names[code] if code >= 0 else None for code in codes],
        "curvature": bend,
        "odom_x": odometry[:, 0],
        "odom_y": odometry[:, 1],
        "odom_heading": odometry[:, 2],
        "timestamp": np.array([np.nan if s.timestamp is None else s.timestamp for s in sightings]),
    }
