"""Build a store from a scan: decode, check and write in a temporary folder, then rename it."""

from __future__ import annotations

import os
import shlex
import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from tempfile import TemporaryFile

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import array_writer, stored_array
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.ingest_folder import BuildingFolder, building_folder, building_folders
from s2rstore.files.ledger import Ledger
from s2rstore.index.transaction import edit
from s2rstore.records import Domain
from s2rtools.common.read_ahead import map_ahead
from s2rtools.datasets.floor_plan import read_floor_plan
from s2rtools.datasets.frame_cache import FrameCache
from s2rtools.datasets.index_rows import StoredRecords, write_index
from s2rtools.datasets.scan import DecodedFrame, FrameChecksum, InputIssue, InstanceRecord, Scan

SHARD_ROWS = 64
_MAX_FLOOR_PLAN_SIDE = 1056
_DECODING_BYTES = 256 << 20
"""Memory of all threads together for decoding source images."""

ReportProgress = Callable[[int], None]
ReportLine = Callable[[str], object]


def build(
    scan: Scan,
    target: Path,
    command: str,
    strict: bool,
    progress: ReportProgress,
    report_line: ReportLine = lambda line: None,
) -> None:
    """Decode, check and store a scan as a new store at `target`.

    Instances with an unusable frame are left out and reported in `scan.issues`. `progress` is
    called with the number of finished frames, `report_line` with a line about the remains of an
    interrupted ingest of the same store. Raises RequestError if `target` exists, if nothing is
    usable, or with `strict` if there is any issue.
    """
    if target.exists():
        raise RequestError(
            f"{target}: exists; choose another --store, remove it, or add to it with --append"
        )
    report_outside_bounds(scan)
    refuse_unusable(scan, strict)
    folder = building_folder(target)
    remove_leftovers(building_folders(target), report_line)
    try:
        folder.mkdir(parents=True)
        stored = write_frames(scan, folder, progress)
        plan = _write_floor_plan(scan, folder)
        refuse_unusable(scan, strict)
        if scan.drives:
            scan.drives(folder / layout.DRIVES)
        with edit(folder) as draft:
            write_index(draft, scan, stored, plan, command)
            draft.record_checksums(unlisted_checksums(folder))
        folder.rename(target)
        atomic_writes.sync_path(target.parent)
    except OSError as error:
        where = error.filename or target
        raise RequestError(f"{where}: cannot be written ({error.strerror})") from error
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def report_outside_bounds(scan: Scan) -> None:
    """Add an issue for every pose outside the bounds."""
    edges = scan.bounds
    posed = scan.trajectories.values() if scan.has_poses else ()
    for record in (record for records in posed for record in records):
        if not (edges.x0 <= record.x <= edges.x1 and edges.y0 <= record.y <= edges.y1):
            file = next(iter(record.sources.values())).file_names(scan)[0] or scan.name
            detail = f"({record.x:g}, {record.y:g}); stored anyway"
            scan.issues.append(InputIssue("pose outside the bounds", file, detail))


def write_frames(scan: Scan, root: Path, progress: ReportProgress) -> StoredRecords:
    """Write the frames of all trajectories below `root`; returns the usable instances.

    Trajectories without a usable instance are left out; it is an issue if that leaves none.
    """
    stored = {
        name: list(_write_trajectory(scan, root, name, records, progress))
        for name, records in scan.trajectories.items()
    }
    stored = {name: rows for name, rows in stored.items() if rows}
    if not stored:
        scan.issues.append(InputIssue("empty data set", str(scan.root), f"no usable {scan.unit}"))
    return stored


def remove_leftovers(folders: list[BuildingFolder], report_line: ReportLine) -> None:
    """Remove the building folders of ingests that have ended; report every such folder.

    Folders stay whose process runs, or may run on another host.
    """
    for folder in folders:
        if folder.is_abandoned:
            shutil.rmtree(folder.path, ignore_errors=True)
            if not folder.path.exists():
                report_line(
                    f"{folder.path}: removed; an interrupted ingest ({folder.builder}) had left it"
                )
                continue
        report_line(
            f"{folder.path}: left by another ingest ({folder.builder}); "
            f"when that has ended, remove it with: rm -r {shlex.quote(str(folder.path))}"
        )


def refuse_unusable(scan: Scan, strict: bool) -> None:
    """Raise RequestError where there is no instance, or with `strict` where there is any issue."""
    issues = scan.issues or [InputIssue("empty data set", str(scan.root))]
    fatal = not scan.trajectories or any(i.kind == "empty data set" for i in scan.issues)
    if fatal or (strict and scan.issues):
        first, more = issues[0], f" and {len(issues) - 1} more" if len(issues) > 1 else ""
        raise RequestError(
            f"{first.file}: {first.kind} {first.detail}".rstrip() + f"{more}; nothing was ingested"
        )


def _write_trajectory(
    scan: Scan, root: Path, name: str, records: list[InstanceRecord], progress: ReportProgress
) -> Iterator[tuple[InstanceRecord, dict[str, FrameChecksum]]]:
    """Write the usable instances of one trajectory in two passes.

    The first pass decodes and checks every frame, so that arrays are created with their final
    length; the second pass writes them shard by shard. Both use one thread per processor, fewer
    if source images are large, to bound the memory.
    """
    largest = max(source.pixels for record in records for source in record.sources.values())
    threads = max(1, min(os.cpu_count() or 1, _DECODING_BYTES // (8 * largest)))
    with TemporaryFile(dir=root) as file, ThreadPoolExecutor(threads) as pool:
        cache = FrameCache(file)
        usable = _usable_records(scan, pool, records, cache, progress)
        if not usable:
            return
        checksums: dict[str, list[FrameChecksum]] = {}
        for domain in (scan.domains[name] for name in usable[0].sources):
            frames = map_ahead(pool, partial(_decode, scan, domain), usable)
            checksums[domain.domain] = list(_write_frames(root, name, domain, frames, len(usable)))
            progress(len(usable))
    for row, record in enumerate(usable):
        yield record, {domain: rows[row] for domain, rows in checksums.items()}


def _usable_records(
    scan: Scan,
    pool: Executor,
    records: list[InstanceRecord],
    cache: FrameCache,
    progress: ReportProgress,
) -> list[InstanceRecord]:
    """The records whose frames all decode, with the most common depth dtype of each domain."""
    decoded: list[tuple[InstanceRecord, list[InputIssue]]] = []
    for record, defects, conversions in map_ahead(pool, partial(_check, scan, cache), records):
        progress(len(record.sources))
        scan.issues += defects
        if not defects:
            decoded.append((record, conversions))
    expected = {
        name: Counter(record.sources[name].depth_type for record, _ in decoded).most_common(1)[0][0]
        for name in (decoded[0][0].sources if decoded else ())
    }
    usable = []
    for record, conversions in decoded:
        types = {name: source.depth_type for name, source in record.sources.items()}
        differing = [name for name in expected if types[name] != expected[name]]
        for name in differing:
            file = record.sources[name].file_names(scan)[1] or name
            detail = f"{types[name]}, the others are {expected[name]}"
            scan.issues.append(InputIssue("mixed depth types", file, detail))
        if not differing:
            scan.issues += conversions
            usable.append(record)
    return usable


def _check(
    scan: Scan, cache: FrameCache, record: InstanceRecord
) -> tuple[InstanceRecord, list[InputIssue], list[InputIssue]]:
    """Decode the frames that only decoding can check, and move them into the cache.

    Returns the record, the issues that make it unusable, and those of lossy conversions.
    """
    sources = dict(record.sources)
    defects: list[InputIssue] = []
    conversions: list[InputIssue] = []
    for name, source in record.sources.items():
        if source.depth_type is None:
            frame = source.decode(scan, scan.domains[name])
            if isinstance(frame, InputIssue):
                defects.append(frame)
            else:
                sources[name] = cache.add(source, frame)
                conversions += frame.issues
    return replace(record, sources=sources), defects, conversions


def _decode(scan: Scan, domain: Domain, record: InstanceRecord) -> DecodedFrame:
    frame = record.sources[domain.domain].decode(scan, domain)
    if isinstance(frame, InputIssue):
        raise RequestError(f"{frame.file}: changed while it was read; ingest again")
    return frame


def _write_frames(
    root: Path, trajectory: str, domain: Domain, frames: Iterator[DecodedFrame], count: int
) -> Iterator[FrameChecksum]:
    ledger = Ledger(root)
    folder = Path(layout.FRAMES, domain.domain, trajectory)
    shard = 0
    while block := list(islice(frames, SHARD_ROWS)):
        images = {"rgb": np.stack([frame.rgb for frame in block])}
        if depths := [frame.depth for frame in block if frame.depth is not None]:
            images["depth"] = np.stack(depths)
        for image, rows in images.items():
            relative = folder / image
            if shard == 0:
                plan = array_writer.plan_layout(count, rows.shape[1:], str(rows.dtype), SHARD_ROWS)
                array_writer.create(root / relative, plan, root=root)
            file = array_writer.write_shard(root / relative, shard, rows, root)
            key = f"frames:{domain.domain}:{trajectory}:{image}:{shard}"
            ledger.add(key, [(file.path, len(rows))])
        shard += 1
        yield from (FrameChecksum(frame.sha256, frame.valid_fraction) for frame in block)


def _write_floor_plan(scan: Scan, root: Path) -> str | None:
    image = floor_plan_image(scan)
    if image is None:
        return None
    name = f"{layout.ASSETS}/floor_plan.png"
    atomic_writes.write(root, name, cv2.imencode(".png", image)[1].tobytes())
    return name


def floor_plan_image(scan: Scan) -> NDArray[np.uint8] | None:
    """The floor plan (h, w, 3) BGR as it is stored; None without one. Reports an unreadable one."""
    if scan.floor_plan is None:
        return None
    if isinstance(scan.floor_plan, Path):
        image = read_floor_plan(scan.floor_plan)
        if image is None:
            file = scan.relative(scan.floor_plan)
            scan.issues.append(InputIssue("unreadable floor plan", file))
            return None
    else:
        image = cv2.cvtColor(scan.floor_plan, cv2.COLOR_RGB2BGR)
    scale = min(1.0, _MAX_FLOOR_PLAN_SIDE / max(image.shape[:2]))
    size = round(image.shape[1] * scale), round(image.shape[0] * scale)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def unlisted_checksums(root: Path) -> dict[str, str]:
    """SHA-256 of the files that the ledger does not list: array metadata, floor plan, drives."""
    return {
        entry.path: safe_files.sha256(root, entry.path)
        for entry in safe_files.walk(root)
        if entry.kind == "file"
        and (
            entry.name == stored_array.METADATA
            or entry.path.startswith((f"{layout.ASSETS}/", f"{layout.DRIVES}/"))
        )
    }
