"""From a scan to a published store, built beside and renamed: nothing half-ingested is seen."""

from __future__ import annotations

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from s2rstore.arrays import stored_array
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.ingest_folder import building_folder
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import edit
from s2rstore.records import Domain
from s2rtools.common.bounded_map import ahead
from s2rtools.datasets.floor_plan import read_floor_plan
from s2rtools.datasets.index_rows import write_index
from s2rtools.datasets.interrupted_ingests import Say, remove_leftovers
from s2rtools.datasets.scan import (
    CheckedFrame,
    DecodedFrame,
    FrameChecksum,
    InputIssue,
    InstanceRecord,
    Scan,
)
from s2rtools.datasets.view_cache import ViewCache

SHARD_ROWS = 64
_PLAN_SIDE = 1056
_DECODING = 256 << 20
"""Bytes that all threads together may take for decoding source images."""

Progress = Callable[[int], None]


def build(
    scan: Scan,
    target: Path,
    command: str,
    strict: bool,
    progress: Progress,
    say: Say = lambda line: None,
) -> None:
    """Decode, check and store a scan as a new store at `target`.

    Instances with an unusable view are left out and reported in `scan.problems`. Raises
    RequestError where `target` exists, where nothing is usable, or with `strict` where anything
    was reported. `progress` is called with the number of finished views, `say` with a line on what
    an interrupted ingest of the same store has left.
    """
    if target.exists():
        raise RequestError(f"{target}: exists; choose another --store, or remove it")
    _report_outside(scan)
    _refuse(scan, strict)
    beside = building_folder(target)
    remove_leftovers(target, say)
    try:
        beside.mkdir(parents=True)
        kept = {
            name: list(_write_trajectory(scan, beside, name, rows, progress))
            for name, rows in scan.trajectories.items()
        }
        kept = {name: rows for name, rows in kept.items() if rows}
        if not kept:
            scan.problems.append(InputIssue("empty data set", str(scan.root), "no usable pair"))
        plan = _write_floor_plan(scan, beside)
        _refuse(scan, strict)
        if scan.drives:
            scan.drives(beside / layout.DRIVES)
        with edit(beside) as draft:
            write_index(draft, scan, kept, plan, command)
            draft.record_checksums(_checksums(beside))
        beside.rename(target)
        atomic_writes.sync_path(target.parent)
    except OSError as error:
        where = error.filename or target
        raise RequestError(f"{where}: cannot be written ({error.strerror})") from error
    finally:
        shutil.rmtree(beside, ignore_errors=True)


def _refuse(scan: Scan, strict: bool) -> None:
    fatal = [p for p in scan.problems if p.kind == "empty data set"] or not scan.trajectories
    if fatal or (strict and scan.problems):
        first = scan.problems[0] if scan.problems else InputIssue("empty data set", str(scan.root))
        more = f" and {len(scan.problems) - 1} more" if len(scan.problems) > 1 else ""
        raise RequestError(
            f"{first.file}: {first.kind} {first.detail}".rstrip() + f"{more}; nothing was ingested"
        )


def _write_trajectory(
    scan: Scan, root: Path, name: str, sightings: list[InstanceRecord], progress: Progress
) -> Iterator[tuple[InstanceRecord, dict[str, FrameChecksum]]]:
    """Write the usable instances of one trajectory; two passes keep memory small.

    The first pass decodes and checks every view, so that the arrays get their final length at once.
    """
    with ViewCache(root) as cache, ThreadPoolExecutor(_threads(sightings)) as pool:
        usable = _usable(scan, pool, sightings, cache, progress)
        if not usable:
            return
        facts: dict[str, list[FrameChecksum]] = {}
        for domain in scan.domains.values():
            views = ahead(pool, partial(_decoded, scan, domain), usable)
            facts[domain.domain] = list(_write_frames(root, name, domain, views, len(usable)))
            progress(len(usable))
    for row, sighting in enumerate(usable):
        yield sighting, {domain: facts[domain][row] for domain in facts}


def _threads(sightings: list[InstanceRecord]) -> int:
    """One per processor, and fewer where source images are so large that memory would not do."""
    largest = max(picture.pixels for row in sightings for picture in row.images.values())
    return max(1, min(os.cpu_count() or 1, _DECODING // (8 * largest)))


def _usable(
    scan: Scan,
    pool: Executor,
    sightings: list[InstanceRecord],
    cache: ViewCache,
    progress: Progress,
) -> list[InstanceRecord]:
    """The sightings whose views all decode to one type of depth per domain."""
    good: list[tuple[InstanceRecord, dict[str, CheckedFrame]]] = []
    for sighting, found in ahead(pool, partial(_checked, scan, cache), sightings):
        progress(len(sighting.images))
        bad = [problem for problem in found.values() if isinstance(problem, InputIssue)]
        scan.problems += bad
        if not bad:
            good.append((sighting, {d: c for d, c in found.items() if isinstance(c, CheckedFrame)}))
    usual = {
        domain: Counter(found[domain].depth_type for _, found in good).most_common(1)[0][0]
        for domain in (scan.domains if good else ())
    }
    usable = []
    for sighting, views in good:
        odd = [domain for domain in usual if views[domain].depth_type != usual[domain]]
        for domain in odd:
            file = sighting.images[domain].files(scan)[1] or domain
            detail = f"{views[domain].depth_type}, the others are {usual[domain]}"
            scan.problems.append(InputIssue("mixed depth types", file, detail))
        if not odd:
            scan.problems += [note for view in views.values() for note in view.notes]
            usable.append(sighting)
    return usable


def _checked(
    scan: Scan, cache: ViewCache, sighting: InstanceRecord
) -> tuple[InstanceRecord, dict[str, CheckedFrame | InputIssue]]:
    """What was found of each domain's view; decoded ones are kept in the cache."""
    images = dict(sighting.images)
    found: dict[str, CheckedFrame | InputIssue] = {}
    for name, picture in sighting.images.items():
        checked = picture.check(scan, scan.domains[name])
        if isinstance(checked, CheckedFrame) and checked.view is not None:
            images[name] = cache.add(picture, checked.view)
            checked = replace(checked, view=None)
        found[name] = checked
    return replace(sighting, images=images), found


def _report_outside(scan: Scan) -> None:
    edges = scan.bounds
    for rows in scan.trajectories.values():
        for row in rows:
            if not (edges.x0 <= row.x <= edges.x1 and edges.y0 <= row.y <= edges.y1):
                file = next(iter(row.images.values())).files(scan)[0] or scan.name
                detail = f"({row.x:g}, {row.y:g}); kept"
                scan.problems.append(InputIssue("pose outside the bounds", file, detail))


def _decoded(scan: Scan, domain: Domain, sighting: InstanceRecord) -> DecodedFrame:
    view = sighting.images[domain.domain].view(scan, domain)
    if isinstance(view, InputIssue):
        raise RequestError(f"{view.file}: changed while it was read; ingest again")
    return view


def _write_frames(
    root: Path, trajectory: str, domain: Domain, views: Iterator[DecodedFrame], count: int
) -> Iterator[FrameChecksum]:
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
                plan = stored_array.plan_layout(count, rows.shape[1:], str(rows.dtype), SHARD_ROWS)
                stored_array.create(root / relative, plan, root=root)
            file = stored_array.write_shard(root / relative, shard, rows, root)
            key = f"frames:{domain.domain}:{trajectory}:{image}:{shard}"
            ledger.add(key, [(file.relative_to(root).as_posix(), len(rows))])
        shard += 1
        yield from (FrameChecksum(view.sha256, view.valid_fraction) for view in block)


def _write_floor_plan(scan: Scan, root: Path) -> str | None:
    if scan.floor_plan is None:
        return None
    if isinstance(scan.floor_plan, Path):
        picture = read_floor_plan(scan.floor_plan)
        if picture is None:
            scan.problems.append(
                InputIssue("unreadable floor plan", scan.relative(scan.floor_plan))
            )
            return None
    else:
        picture = cv2.cvtColor(scan.floor_plan, cv2.COLOR_RGB2BGR)
    scale = min(1.0, _PLAN_SIDE / max(picture.shape[:2]))
    size = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    name = f"{layout.ASSETS}/floor_plan.png"
    atomic_writes.write(root, name, cv2.imencode(".png", small)[1].tobytes())
    return name


def _checksums(root: Path) -> dict[str, str]:
    """Of every file that the ledger does not prove: metadata of arrays, floor plan, drives."""
    return {
        entry.path: safe_files.sha256(root, entry.path)
        for entry in safe_files.walk(root)
        if entry.kind == "file"
        and (
            entry.name == stored_array.METADATA
            or entry.path.startswith((f"{layout.ASSETS}/", f"{layout.DRIVES}/"))
        )
    }
