"""Check the conventions of a data set while it is ingested, and draw what was compared."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.files import atomic_writes, layout
from s2rstore.geometry import angles
from s2rstore.reader import Store
from s2rstore.records import Bounds
from s2rtools.datasets.convention_check import (
    DECLARED,
    MAX_FRAMES,
    Convention,
    ConventionCheck,
    check_conventions,
)
from s2rtools.datasets.depth_frames import (
    DepthFrames,
    DepthPoints,
    first_rows,
    pixels_on_map,
    read_depth,
)
from s2rtools.datasets.scan import InputIssue, Scan
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


def check_ingested(
    scan: Scan, stored: StoredRecords, root: Path, plan: Image | None
) -> list[ConventionCheck]:
    """Check the frames below `root`, which become a store, and add the result to it.

    `plan` (h, w, 3) BGR fills the bounds. Writes `PICTURE` and the section `PROVENANCE` of the
    scan, and adds an issue for each domain whose declared conventions are doubtful.
    """
    if not scan.has_poses:
        return []
    searched = first_rows(stored, _MAX_SEARCHED)
    rows = [searched[row] for row in _moving_rows(np.array([each.pose for each in searched]))]
    read = (read_depth(scan, domain, rows, root) for domain in scan.domains.values())
    compared = [frames for frames in read if frames is not None]
    checks = [check_conventions(frames) for frames in compared]
    if not checks:
        return []
    picture = draw(compared, checks, scan.bounds, plan)
    atomic_writes.write(root, PICTURE, cv2.imencode(".png", picture)[1].tobytes())
    scan.provenance[PROVENANCE] = {
        check.domain: {**check.facts(), "picture": PICTURE} for check in checks
    }
    scan.issues += doubts(checks)
    return checks


def check_stored(store: Store, first_iid: int) -> list[ConventionCheck]:
    """Check the frames of a store from an iid on."""
    truth = store.instances
    poses = np.stack([truth.x, truth.y, truth.heading], axis=1)[first_iid:]
    rows = first_iid + np.array(_moving_rows(poses), dtype=np.int64)
    checks = []
    for domain in store.domains.values():
        if not domain.has_depth:
            continue
        depth = [store.frames(domain.domain, row, row + 1, ("depth",))["depth"] for row in rows]
        frames = DepthFrames(
            domain, np.concatenate(depth), store.poses(domain.domain)[rows], store.dataset.y_down
        )
        checks.append(check_conventions(frames))
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
    compared: Sequence[DepthFrames],
    checks: Sequence[ConventionCheck],
    bounds: Bounds,
    plan: Image | None,
) -> Image:
    """The points on the plan, BGR: a row per domain, as declared and under the best other one."""
    rows = []
    for frames, check in zip(compared, checks, strict=True):
        points = DepthPoints(frames)
        shown = [DECLARED, check.best_other] if check.sharpness else [DECLARED]
        panels = [_panel(points, each, check, bounds, plan) for each in shown]
        rows.append(np.concatenate(panels + [np.full_like(panels[0], 255)] * (2 - len(panels)), 1))
    return np.concatenate(rows)


def _panel(
    points: DepthPoints,
    convention: Convention,
    check: ConventionCheck,
    bounds: Bounds,
    plan: Image | None,
) -> Image:
    scale = _PANEL / max(bounds.width, bounds.height)
    size = max(1, round(bounds.height * scale)), max(1, round(bounds.width * scale))
    panel = np.full((*size, 3), 255, np.uint8)
    if plan is not None:
        small = cv2.resize(plan, size[::-1], interpolation=cv2.INTER_AREA)
        pale = np.uint8(170) + cv2.cvtColor(small, cv2.COLOR_BGR2GRAY) // np.uint8(3)
        panel = np.asarray(cv2.cvtColor(pale, cv2.COLOR_GRAY2BGR), np.uint8)
    x, y = convention.on_floor(points)
    seen = pixels_on_map(x, y, bounds, points.source.y_down, size)[..., None]
    full = np.percentile(seen[seen > 0], 95) if seen.any() else 1.0
    shade = np.where(seen > 0, np.minimum(1.0, 0.3 + seen / full), 0.0)
    panel = (panel * (1 - shade) + _POINTS * shade).astype(np.uint8)
    found = check.sharpness.get(convention)
    figure = "" if found is None else f" ({found.information:.2f} nats)"
    caption = np.full((_CAPTION, size[1], 3), 255, np.uint8)
    text = f"{check.domain}: {convention}{figure}"
    cv2.putText(caption, text, (4, 15), _FONT, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate([caption, panel])
