"""Check the conventions of a data set while it is ingested, and draw what was compared."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.geometry import angles
from s2rstore.reader import Store
from s2rstore.records import Bounds, Domain
from s2rtools.datasets.convention_check import (
    DECLARED,
    MAX_FRAMES,
    Convention,
    ConventionCheck,
    DepthPoints,
    check_domain,
)
from s2rtools.datasets.scan import InputIssue, InstanceRecord, Scan
from s2rtools.datasets.stored_instances import StoredRecords

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]

PICTURE = f"{layout.ASSETS}/conventions.png"
PROVENANCE = "conventions"
"""Section of the provenance that holds the figures of each domain."""
_MOVED, _TURNED = 0.1, np.radians(5)
"""Metres or radians between two frames that are compared: a slow video shows nothing new."""
_MAX_SEARCHED = 5000
"""Instances among which these frames are chosen."""
_PANEL, _CAPTION = 480, 22
_POINTS = np.array([160, 60, 20])
"""Colour of many points, BGR."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX


@dataclass(frozen=True, slots=True, eq=False)
class ComparedFrames:
    """Depth (n, h, w) raw values of a domain at poses (n, 3), x, y in metres and heading."""

    domain: Domain
    depth: NDArray[Any]
    poses: Floats


def check_ingested(
    scan: Scan, stored: StoredRecords, root: Path, plan: Image | None
) -> list[ConventionCheck]:
    """Check the frames below `root`, which become a store, and add the result to it.

    `plan` (h, w, 3) BGR fills the bounds. Writes `PICTURE` and the section `PROVENANCE` of the
    scan, and adds an issue for each domain whose declared conventions are doubtful.
    """
    compared = list(_frames_of_scan(scan, stored, root)) if scan.has_poses else []
    checks = [check_domain(e.domain, e.depth, e.poses, scan.y_down) for e in compared]
    if not checks:
        return []
    picture = draw(compared, checks, scan.bounds, scan.y_down, plan)
    atomic_writes.write(root, PICTURE, cv2.imencode(".png", picture)[1].tobytes())
    scan.provenance[PROVENANCE] = {check.domain: check.facts() for check in checks} | {
        "picture": PICTURE
    }
    scan.issues += doubts(checks)
    return checks


def check_stored(store: Store, first_iid: int) -> list[ConventionCheck]:
    """Check the frames of a store from an iid on."""
    truth = store.instances
    poses = np.stack([truth.x, truth.y, truth.heading], axis=1)[first_iid:]
    rows = first_iid + np.array(_moving_rows(poses), dtype=np.int64)
    checks = []
    for domain in store.domains.values() if store.has_poses else ():
        depth = [store.frames(domain.domain, row, row + 1, ("depth",))["depth"] for row in rows]
        chosen = poses[rows - first_iid]
        checks.append(check_domain(domain, np.concatenate(depth), chosen, store.dataset.y_down))
    return checks


def doubts(checks: Sequence[ConventionCheck]) -> list[InputIssue]:
    """An issue for each domain whose points are sharper under another convention."""
    return [
        InputIssue(
            "convention doubtful",
            check.domain,
            f"depth of {check.frames} frames is sharper on the floor with {check.best_other}: "
            f"{check.sharpness[check.best_other].information:.2f} nats, "
            f"{check.sharpness[DECLARED].information:.2f} as declared",
        )
        for check in checks
        if check.verdict == "doubtful"
    ]


def report_line(checks: Sequence[ConventionCheck]) -> str:
    """All results in one line."""
    return f"headings, handedness and depth scale: {', '.join(check.text for check in checks)}"


def _frames_of_scan(scan: Scan, stored: StoredRecords, root: Path) -> Iterator[ComparedFrames]:
    """The frames to compare of each domain that has depth, the same instances in each."""
    rows = _rows_of_scan(stored)
    for name, domain in scan.domains.items():
        depth, poses = [], []
        for trajectory, row, record in rows:
            folder = f"{layout.FRAMES}/{name}/{trajectory}/depth"
            if name not in record.sources or safe_files.kind(root, folder) is None:
                continue
            depth.append(stored_array.open_read(root / folder, root).rows(row, row + 1)[0])
            poses.append(_pose(record))
        if depth:
            yield ComparedFrames(domain, np.stack(depth), np.array(poses))


def _pose(record: InstanceRecord) -> tuple[float, float, float]:
    return record.x, record.y, record.heading


def _rows_of_scan(stored: StoredRecords) -> list[tuple[str, int, InstanceRecord]]:
    """Trajectory, row and record of the first instances that are apart from one another."""
    searched = [
        (name, row, record)
        for name in sorted(stored)
        for row, record in enumerate(stored[name].records(0, _MAX_SEARCHED))
    ][:_MAX_SEARCHED]
    poses = np.array([_pose(record) for _, _, record in searched])
    return [searched[row] for row in _moving_rows(poses)]


def _moving_rows(poses: Floats) -> list[int]:
    """The first rows of poses (n, 3) that differ from the one chosen before."""
    rows: list[int] = []
    for row in range(min(len(poses), _MAX_SEARCHED)):
        if len(rows) == MAX_FRAMES:
            break
        last = poses[rows[-1]] if rows else None
        if last is None or (
            np.hypot(*(poses[row, :2] - last[:2])) >= _MOVED
            or angles.distance(poses[row, 2], last[2]) >= _TURNED
        ):
            rows.append(row)
    return rows


def draw(
    compared: Sequence[ComparedFrames],
    checks: Sequence[ConventionCheck],
    bounds: Bounds,
    y_down: bool,
    plan: Image | None,
) -> Image:
    """The points on the plan, BGR: a row per domain, as declared and under the best other one."""
    rows = []
    for frames, check in zip(compared, checks, strict=True):
        points = DepthPoints(frames.domain, frames.depth, frames.poses, y_down)
        shown = [DECLARED, check.best_other] if check.sharpness else [DECLARED]
        panels = [_panel(points, each, check, bounds, y_down, plan) for each in shown]
        rows.append(np.concatenate(panels + [np.full_like(panels[0], 255)] * (2 - len(panels)), 1))
    return np.concatenate(rows)


def _panel(
    points: DepthPoints,
    convention: Convention,
    check: ConventionCheck,
    bounds: Bounds,
    y_down: bool,
    plan: Image | None,
) -> Image:
    scale = _PANEL / max(bounds.width, bounds.height)
    size = max(1, round(bounds.width * scale)), max(1, round(bounds.height * scale))
    if plan is None:
        panel = np.full((size[1], size[0], 3), 255, np.uint8)
    else:
        small = cv2.resize(plan, size, interpolation=cv2.INTER_AREA)
        pale = np.uint8(170) + cv2.cvtColor(small, cv2.COLOR_BGR2GRAY) // np.uint8(3)
        panel = cv2.cvtColor(pale, cv2.COLOR_GRAY2BGR)
    x, y = points.on_floor(convention)
    column = np.floor((x - bounds.x0) * scale).astype(np.int64)
    away = y - bounds.y0 if y_down else bounds.y1 - y
    row = np.floor(away * scale).astype(np.int64)
    inside = (column >= 0) & (column < size[0]) & (row >= 0) & (row < size[1])
    pixels = row[inside] * size[0] + column[inside]
    seen = np.bincount(pixels, minlength=size[0] * size[1]).reshape(size[1], size[0], 1)
    full = np.percentile(seen[seen > 0], 95) if inside.any() else 1.0
    shade = np.where(seen > 0, np.minimum(1.0, 0.3 + seen / full), 0.0)
    panel = (panel * (1 - shade) + _POINTS * shade).astype(np.uint8)
    found = check.sharpness.get(convention)
    figure = "" if found is None else f" ({found.information:.2f} nats)"
    caption = np.full((_CAPTION, size[0], 3), 255, np.uint8)
    text = f"{check.domain}: {convention}{figure}"
    cv2.putText(caption, text, (4, 15), _FONT, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([caption, panel])
