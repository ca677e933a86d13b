"""Append the new trajectories of a scan to a store, as one new generation.

Frames are written into a folder inside the store that no generation references, checked, and moved
to their places while the publish lock is held. A process that is killed at any moment leaves the
store at its generation; the frames that it has moved are replaced when the trajectory is appended
again, and removed by `s2r prune`.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.ingest_folder import appending_folder, appending_folders
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rstore.index import locked_connection
from s2rstore.index.transaction import IndexTransaction, check_writable, edit
from s2rstore.maintenance.prune import frame_folders
from s2rstore.reader import Store
from s2rstore.records import Part
from s2rtools.datasets.build import (
    ReportLine,
    ReportProgress,
    refuse_unusable,
    remove_leftovers,
    report_outside_bounds,
    unlisted_checksums,
    write_frames,
)
from s2rtools.datasets.index_rows import (
    dataset_hash,
    insert_instances,
    now,
    part_hash,
    problem_counts,
)
from s2rtools.datasets.scan import Scan
from s2rtools.datasets.store_agreement import in_store_terms, new_trajectories
from s2rtools.datasets.stored_instances import StoredRecords

_ROOMS = "SELECT position, room FROM room ORDER BY position"


def append(
    scan: Scan,
    target: Path,
    command: str,
    strict: bool,
    progress: ReportProgress,
    report_line: ReportLine = lambda line: None,
) -> dict[str, int]:
    """Decode, check and store the trajectories of a scan that the store `target` does not have.

    New instances follow the existing ones, by trajectory name, then in recording order. Bounds,
    rooms and floor plan stay those of the store. Instances with an unusable frame are left out and
    reported in `scan.issues`. `progress` is called with the number of finished frames,
    `report_line` with a line about each trajectory that the store has already, and about the
    remains of interrupted ingests. Without new trajectories no generation is published.
    Returns the number of new instances by trajectory.

    Raises RequestError if there is no store, if the scan does not agree with it, if a trajectory of
    the store has other images or poses in the scan, if nothing is usable, or with `strict` if
    there is any issue.
    """
    if not target.exists():
        raise RequestError(f"{target}: no such store to append to; leave out --append to make it")
    with s2rstore.open(target) as store:
        check_writable(target)
        scan = in_store_terms(scan, store)
        names, present = new_trajectories(scan, store, progress)
        for name in present:
            report_line(f"trajectory {name}: already in the store")
        if present and not names:
            if strict:
                refuse_unusable(scan, strict)
            report_line(f"{target}: no new trajectory; nothing to append")
            return {}
        scan = replace(scan, trajectories={name: scan.trajectories[name] for name in names})
        report_outside_bounds(scan)
        refuse_unusable(scan, strict)
        remove_leftovers(appending_folders(target), report_line)
        folder = appending_folder(target)
        try:
            folder.mkdir()
            stored = write_frames(scan, folder, progress)
            refuse_unusable(scan, strict)
            _publish(scan, stored, folder, store, command)
        except OSError as error:
            where = error.filename or target
            raise RequestError(f"{where}: cannot be written ({error.strerror})") from error
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    return {name: len(stored[name]) for name in sorted(stored)}


def _publish(scan: Scan, stored: StoredRecords, folder: Path, store: Store, command: str) -> None:
    """Move the frames from `folder` into the store, and publish their instances."""
    entries = _checked_entries(folder)
    checksums = unlisted_checksums(folder)
    with edit(store.path) as draft:
        if draft.rows("SELECT hash FROM dataset") != [(store.dataset.hash,)]:
            raise RequestError(f"{store.path}: another process has changed the data; append again")
        if draft.rows(_ROOMS) != store.execute(_ROOMS):
            raise RequestError(f"{store.path}: another process has renamed rooms; append again")
        _move_frames(folder, store.path)
        Ledger(store.path).add_entries(entries)
        draft.record_checksums(checksums)
        _insert_rows(draft, scan, stored, store, command)


def _checked_entries(folder: Path) -> list[LedgerEntry]:
    """The ledger of `folder`; raises RequestError where a file differs from its entry."""
    ledger = Ledger(folder)
    entries = list(ledger.entries())
    for entry in entries:
        if not ledger.proves([entry]):
            raise RequestError(f"{folder / entry.path}: differs from what was written; try again")
    return entries


def _move_frames(folder: Path, root: Path) -> None:
    """Move the frames of each domain and trajectory; unreferenced ones in their places go."""
    referenced: set[str] | None = None
    for domain in safe_files.names(folder, layout.FRAMES):
        for trajectory in safe_files.names(folder, domain.path):
            if safe_files.kind(root, trajectory.path) is not None:
                referenced = _referenced_frames(root) if referenced is None else referenced
                if trajectory.path in referenced:
                    raise RequestError(
                        f"{root / trajectory.path}: a kept generation has these frames; give the "
                        "trajectory another name"
                    )
                atomic_writes.remove(root, trajectory.path)
            atomic_writes.move(root, f"{folder.name}/{trajectory.path}", trajectory.path)


def _referenced_frames(root: Path) -> set[str]:
    """The folders of frames that a generation up to the published one references."""
    newest = layout.read_current(root).generation
    folders: set[str] = set()
    for entry in safe_files.names(root, layout.INDEX):
        generation = layout.generation_of(Path(entry.path))
        if generation is not None and generation <= newest:
            path = safe_files.checked_path(root, entry.path)
            with locked_connection.connect(path, with_row_files=False) as connection:
                folders |= frame_folders(connection)
    return folders


def _insert_rows(
    draft: IndexTransaction, scan: Scan, stored: StoredRecords, store: Store, command: str
) -> None:
    count = sum(len(trajectory) for trajectory in stored.values())
    parts = list(store.parts)
    if not draft.rows("SELECT 1 FROM part"):
        ingested_at = store.provenance("dataset").get("ingested_at")
        parts = [replace(parts[0], added_at=ingested_at)]
        draft.insert_row("part", _part_row(parts[0]))
    added = Part(len(parts), parts[-1].stop, count, part_hash(scan, stored), now())
    draft.insert_row("part", _part_row(added))
    insert_instances(draft, scan, stored, added.first_iid)
    combined = dataset_hash([part.hash for part in (*parts, added)])
    draft.update("dataset", {"hash": store.dataset.hash}, {"hash": combined})
    fact = {
        "command": command,
        "added_at": added.added_at,
        "trajectories": {name: len(stored[name]) for name in sorted(stored)},
        "problems": problem_counts(scan),
    }
    draft.set_provenance("dataset", {f"append:{added.part}": fact})


def _part_row(part: Part) -> dict[str, object]:
    return {name: getattr(part, name) for name in part.__slots__}
