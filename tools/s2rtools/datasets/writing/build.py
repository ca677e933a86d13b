"""Build a store from a scan: decode, check and write in a temporary folder, then rename it."""

from __future__ import annotations

import hashlib
import os
import shlex
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import numcodecs
import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays import stored_array
from s2rstore.errors import RequestError, StoreBusyError, counted
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.ingest_folder import StagingFolder, staging_folder, staging_folders
from s2rstore.index import schema
from s2rstore.index.transaction import edit
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.conventions import convention_report
from s2rtools.datasets.floor.floor_plans import plan_from_depth, read_floor_plan
from s2rtools.datasets.scan import Scan, StoredRecords
from s2rtools.datasets.writing.frame_writing import FramePlace, ReportProgress, write_trajectory
from s2rtools.datasets.writing.index_rows import write_index
from s2rtools.datasets.writing.ingest_journal import IngestJournal, fingerprint_of

_MAX_FLOOR_PLAN_SIDE = 1056

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
    interrupted ingest of the same store. What an interrupted ingest of the same frames has written
    is taken over. Raises RequestError if `target` exists, if nothing is usable, or with `strict` if
    there is any issue, which is known when all images are decoded; then, and where files cannot be
    written, nothing is left. An interrupt leaves the folder in which the store is built.
    """
    if target.exists():
        raise RequestError(
            f"{target}: exists; choose another --store, remove it, or add to it with --append"
        )
    report_outside_bounds(scan)
    refuse_unusable(scan, strict=False)
    folder = staging_folder(target)
    find_folders = partial(staging_folders, target)
    with building_folder(scan, target, folder, find_folders, {}, report_line) as journal:
        stored = write_frames(scan, folder, progress, journal=journal)
        plan = floor_plan_image(scan)
        drawn = plan_from_depth(scan, stored, folder) if scan.floor_plan is None else None
        plan = plan if drawn is None else drawn.image
        name = None if plan is None else _write_floor_plan(plan, folder)
        checks = convention_report.check_ingested(scan, stored, folder, plan)
        if checks:
            picture = target / convention_report.PICTURE
            report_line(f"{convention_report.line(checks)}; picture {picture}")
        refuse_unusable(scan, strict)
        if scan.drives:
            scan.drives(folder / layout.DRIVES)
        with edit(folder) as draft:
            write_index(draft, scan, stored, name, command)
            draft.set_provenance(schema.CONVENTIONS, convention_report.facts(checks))
            if drawn is not None:
                facts = {"drawn_from": f"depth of {drawn.domain}", "frames": drawn.frames}
                draft.set_provenance("floor_plan", facts)
            draft.record_checksums(unlisted_checksums(folder))
        if journal is not None:
            journal.close()
        folder.rename(target)
        atomic_writes.sync_path(target.parent)


@contextmanager
def building_folder(
    scan: Scan,
    target: Path,
    folder: Path,
    find_folders: Callable[[], list[StagingFolder]],
    places: Mapping[str, FramePlace],
    report_line: ReportLine,
) -> Iterator[IngestJournal | None]:
    """Make the `folder` in which data for `target` is written; gives its journal.

    It is that of an interrupted ingest of the same frames, or a new one. `find_folders` lists the
    folders of all ingests of the store; abandoned ones that are not taken over are removed.
    `places` are as in `write_frames`. There is no journal where a source of the scan does not state
    its origin. The folder is removed where the writing fails; it stays where an ingest with a
    journal is interrupted, or the store is busy: then the same command resumes. Raises RequestError
    where files cannot be written.
    """
    mark, journal = fingerprint(scan, places), None
    try:
        for left in find_folders():
            if left.is_abandoned and mark is not None and fingerprint_of(left.path) == mark:
                try:
                    left.path.rename(folder)  # its name states this process from now on
                except FileNotFoundError:  # another process has taken it over
                    continue
                journal = IngestJournal(folder, mark)
                total = sum(map(len, scan.trajectories.values()))
                report_line(
                    f"{target}: an interrupted ingest ({left.builder}) is resumed; "
                    f"{journal.taken_instances} of {total} instances are not decoded again"
                )
                break
        remove_leftovers([each for each in find_folders() if each.path != folder], report_line)
        if journal is None:
            folder.mkdir(parents=True)
            journal = None if mark is None else IngestJournal(folder, mark)
        yield journal
    except OSError as error:
        shutil.rmtree(folder, ignore_errors=True)
        reason = f"{error.filename or target}: cannot be written ({error.strerror})"
        raise RequestError(reason) from error
    except BaseException as error:
        is_refused = isinstance(error, RequestError) and not isinstance(error, StoreBusyError)
        if journal is None or is_refused:
            shutil.rmtree(folder, ignore_errors=True)
        raise


def report_outside_bounds(scan: Scan) -> None:
    """Add an issue for every pose outside the bounds."""
    edges = scan.bounds
    posed = scan.trajectories.values() if scan.has_poses else ()
    for record in (record for records in posed for record in records):
        if not (edges.x0 <= record.x <= edges.x1 and edges.y0 <= record.y <= edges.y1):
            file = next(iter(record.sources.values())).file_names(scan)[0] or scan.name
            detail = f"({record.x:g}, {record.y:g}); stored anyway"
            scan.issues.append(InputIssue("pose outside the bounds", file, detail))


def write_frames(
    scan: Scan,
    root: Path,
    progress: ReportProgress,
    places: Mapping[str, FramePlace] | None = None,
    journal: IngestJournal | None = None,
) -> StoredRecords:
    """Write the frames of all trajectories below `root`; returns the usable instances.

    `places` are those of trajectories that have frames in the store already, `journal` is that of
    `root`. Trajectories without a usable instance are left out; it is an issue if that leaves none.
    """
    stored: StoredRecords = {}
    for name in scan.trajectories:
        place = (places or {}).get(name)
        trajectory = write_trajectory(scan, root, name, progress, place, journal)
        if trajectory is not None:
            stored[name] = trajectory
    if not stored:
        scan.issues.append(InputIssue("empty data set", str(scan.root), f"no usable {scan.unit}"))
    return stored


def remove_leftovers(folders: list[StagingFolder], report_line: ReportLine) -> None:
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
        more = f"; {counted(len(issues) - 1, 'more issue')}" if len(issues) > 1 else ""
        raise RequestError(f"{issues[0]}{more}; nothing was ingested")


def _write_floor_plan(image: NDArray[np.uint8], root: Path) -> str:
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


@runtime_checkable
class TracedSource(Protocol):
    """A `FrameSource` whose changes are found without reading it."""

    def origin(self) -> tuple[Iterable[Path], str] | None:
        """Files or folders that the frame is read from, and a text of all else it depends on.

        None where it does not know its files.
        """


def fingerprint(scan: Scan, places: Mapping[str, FramePlace] | None = None) -> str | None:
    """SHA-256 of the scan's frame size, domains and sources, and of the releases that decode them.

    `places` are those of trajectories that have frames in the store already. None where a source
    does not state its origin.
    """
    digest = hashlib.sha256()
    facts = [domain.facts() for domain in scan.domains.values()]
    releases = schema.VERSION, cv2.__version__, numcodecs.__version__
    _add(digest, releases, os.path.abspath(scan.root), scan.frame, scan.has_poses, facts)
    _add(digest, [(name, astuple(place)) for name, place in sorted((places or {}).items())])
    folders: dict[Path, str] = {}
    for name, records in scan.trajectories.items():
        _add(digest, name, len(records))
        for record in records:
            for domain, source in record.sources.items():
                origin = source.origin() if isinstance(source, TracedSource) else None
                if origin is None:
                    return None
                files, text = origin
                _add(digest, domain, text, *(_state(path, folders) for path in files))
    return digest.hexdigest()


def _add(digest: hashlib._Hash, *values: object) -> None:
    digest.update(repr(values).encode())


def _state(path: Path, folders: dict[Path, str]) -> str:
    """Path, bytes and time of the last change in nanoseconds; of all files of a folder."""
    if path in folders:
        return folders[path]
    try:
        state = path.stat()
    except OSError:
        return f"{os.path.abspath(path)} is missing"
    if not path.is_dir():
        return f"{os.path.abspath(path)} {state.st_size} {state.st_mtime_ns}"
    files = sorted(each for each in path.rglob("*") if not each.is_dir())
    folders[path] = repr([_state(each, folders) for each in files])
    return folders[path]
