"""Check the conventions of a data set while it is ingested, and draw what was compared."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.files import atomic_writes, layout
from s2rstore.geometry import angles
from s2rstore.records import Bounds
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.conventions.convention_check import (
    DECLARED,
    MAX_FRAMES,
    ORDERS,
    Convention,
    ConventionCheck,
    check_conventions,
)
from s2rtools.datasets.conventions.depth_frames import (
    DepthFrames,
    DepthPoints,
    pixels_on_map,
    read_depth,
    stored_rows,
)
from s2rtools.datasets.scan import Scan, StoredRecords

Floats = NDArray[np.float64]
Image = NDArray[np.uint8]
Row = TypeVar("Row")

PICTURE = f"{layout.ASSETS}/conventions.png"
_ROUNDING = 1e-6
_MOVED, _TURNED = 0.1 - _ROUNDING, np.radians(5) - _ROUNDING
"""Least metres or radians between two frames that are compared: a slow video shows nothing new."""
_MAX_SEARCHED = 5000
"""Instances among which these frames are chosen."""
_PANEL, _CAPTION = 480, 22
_POINTS = np.array([160, 60, 20])
"""Colour of many points, BGR."""
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def check_ingested(
    scan: Scan, stored: StoredRecords, root: Path, plan: Image | None
) -> list[ConventionCheck]:
    """Check the frames below `root`, which become a store, and draw what was compared.

    `plan` (h, w, 3) BGR fills the bounds. Writes `PICTURE`, and adds an issue to the scan for each
    domain whose declared conventions are doubtful. Empty without poses or depth.
    """
    compared = _compared(scan, stored, root, {})
    checks = [check_conventions(frames) for frames in compared]
    if checks:
        picture = draw(compared, checks, scan.bounds, plan)
        atomic_writes.write(root, PICTURE, cv2.imencode(".png", picture)[1].tobytes())
        scan.issues += doubts(checks)
    return checks


def check_appended(
    scan: Scan, stored: StoredRecords, root: Path, folders: Mapping[str, str]
) -> list[ConventionCheck]:
    """As `check_ingested` without a picture, for frames that are appended to a store.

    `folders` are those of the frames of trajectories that have frames in the store already.
    """
    checks = [check_conventions(frames) for frames in _compared(scan, stored, root, folders)]
    scan.issues += doubts(checks)
    return checks


def _compared(
    scan: Scan, stored: StoredRecords, root: Path, folders: Mapping[str, str]
) -> list[DepthFrames]:
    """Frames of each domain with depth, whose poses are apart."""
    if not scan.has_poses:
        return []
    rows = _moving(islice(stored_rows(stored), _MAX_SEARCHED), lambda each: each.pose)
    read = (
        read_depth(scan, domain, rows, root, folders, ORDERS) for domain in scan.domains.values()
    )
    return [frames for frames in read if frames is not None]


def facts(checks: Sequence[ConventionCheck]) -> dict[str, dict[str, Any]]:
    """The figures of each domain, for section `schema.CONVENTIONS` of a store's provenance."""
    return {check.domain: {**check.facts(), "picture": PICTURE} for check in checks}


def appended_facts(checks: Sequence[ConventionCheck], part: int) -> dict[str, dict[str, Any]]:
    """As `facts`, for the instances of an appended part."""
    return {f"{check.domain}@{part}": check.facts() for check in checks}


def doubts(checks: Sequence[ConventionCheck]) -> list[InputIssue]:
    """An issue for each domain whose points are sharper under another convention."""
    return [
        InputIssue(
            "convention doubtful",
            check.domain,
            f"{check.best_other.finding}; images and poses of {check.frames} frames agree best "
            f"with {check.best_other} ({check.figures})",
        )
        for check in checks
        if check.verdict == "doubtful"
    ]


def line(checks: Sequence[ConventionCheck]) -> str:
    """All results in one line."""
    return f"headings, handedness and depth scale: {', '.join(check.text for check in checks)}"


def _moving(rows: Iterable[Row], pose: Callable[[Row], Sequence[float] | Floats]) -> list[Row]:
    """The first `MAX_FRAMES` rows whose pose is apart from that of the row chosen before."""
    chosen: list[Row] = []
    last: Sequence[float] | Floats | None = None
    for row in rows:
        here = pose(row)
        if last is None or (
            np.hypot(here[0] - last[0], here[1] - last[1]) >= _MOVED
            or angles.distance(here[2], last[2]) >= _TURNED
        ):
            chosen.append(row)
            last = here
            if len(chosen) == MAX_FRAMES:
                break
    return chosen


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
