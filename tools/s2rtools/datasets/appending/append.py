"""Append the instances and domains of a scan that a store does not have, as one new generation.

Frames are written into a folder inside the store that no generation references, checked, and moved
to their places while the publish lock is held. A process that is killed at any moment leaves the
store at its generation. Appending the same data again takes over what its folder holds and replaces
the frames that it has moved; `s2r prune` removes both.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import s2rstore
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.ingest_folder import append_staging_folder, append_staging_folders
from s2rstore.files.ledger import Ledger, LedgerEntry
from s2rstore.index import locked_connection, schema
from s2rstore.index.transaction import IndexTransaction, check_writable, edit
from s2rstore.lazy_sequence import LazySequence
from s2rstore.maintenance.prune import frame_folders
from s2rstore.reader import Store
from s2rstore.records import Part, TrajectoryPart
from s2rtools.datasets.appending.instance_agreement import Additions, additions, stored_depth_types
from s2rtools.datasets.appending.new_domains import (
    DomainFrames,
    depth_types,
    insert_domains,
    write_domain_frames,
)
from s2rtools.datasets.appending.store_agreement import in_store_terms
from s2rtools.datasets.conventions import convention_report
from s2rtools.datasets.conventions.convention_check import ConventionCheck
from s2rtools.datasets.scan import InstanceRecord, Scan, StoredRecords
from s2rtools.datasets.writing.build import (
    ReportLine,
    ReportProgress,
    building_folder,
    refuse_unusable,
    report_outside_bounds,
    unlisted_checksums,
    write_frames,
)
from s2rtools.datasets.writing.frame_writing import FramePlace
from s2rtools.datasets.writing.index_rows import (
    TrajectoryEnd,
    dataset_hash,
    insert_instances,
    now,
    part_hash,
    problem_counts,
)
from s2rtools.datasets.writing.ingest_journal import IngestJournal

_ROOMS = "SELECT position, room FROM room ORDER BY position"
_DOMAIN_HASHES = "SELECT hash FROM domain WHERE hash IS NOT NULL ORDER BY domain"


@dataclass(frozen=True, slots=True)
class Appended:
    """What was added: the number of new instances by trajectory, and the names of new domains."""

    instances: dict[str, int]
    domains: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Written:
    """What lies in the folder of an append: frames of instances and of new domains.

    `ends` are those of the trajectories that are continued; `checks` are those of the conventions
    of the new instances.
    """

    stored: StoredRecords
    domains: tuple[str, ...]
    domain_frames: DomainFrames
    ends: dict[str, TrajectoryEnd]
    checks: list[ConventionCheck]


def append(
    scan: Scan,
    target: Path,
    command: str,
    strict: bool,
    progress: ReportProgress,
    report_line: ReportLine = lambda line: None,
) -> Appended:
    """Decode, check and store what a scan has and the store `target` does not have.

    These are new trajectories, further instances behind those of a trajectory, and new domains of
    stored trajectories or of new instances. New instances follow the existing ones, by trajectory
    name, then in recording order. Bounds, rooms and floor plan stay those of the store. Instances
    with an unusable frame are left out and reported in `scan.issues`. `progress` is called with the
    number of finished frames, `report_line` with a line about each trajectory that the store has
    already, about the remains of interrupted ingests, and about the conventions of the new
    instances. What an interrupted append of the same frames has written is taken over; frames of
    new domains are written anew. Where there is nothing new, no generation is published.

    Raises RequestError if there is no store, if the scan does not agree with it, if a trajectory of
    the store has other images or poses in the scan, if a new domain images a part of a stored
    trajectory, if nothing is usable, or with `strict` if there is any issue.
    """
    if not target.exists():
        raise RequestError(f"{target}: no such store to append to; leave out --append to make it")
    with s2rstore.open(target) as store:
        check_writable(target)
        scan = in_store_terms(scan, store)
        found = additions(scan, store, progress)
        for name in found.rows:
            further = "; its further instances are added" if name in found.continued else ""
            report_line(f"trajectory {name}: already in the store{further}")
            if name in found.renumbered:
                further = "; added ones are numbered on from the last stored one"
                report_line(
                    f"trajectory {name}: {found.renumbered[name].text}"
                    f"{further if name in found.continued else ''}"
                )
        if found.unchanged and found.is_empty:
            if strict:
                refuse_unusable(scan, strict)
            report_line(f"{target}: no new instances or domains; nothing to append")
            return Appended({})
        added = replace(scan, trajectories=_added_records(scan, found))
        report_outside_bounds(added)
        refuse_unusable(scan if found.domains else added, strict)
        part, folder = len(store.parts), append_staging_folder(target)
        places = {
            name: FramePlace(
                TrajectoryPart.later_folder(name, part), stored_depth_types(store, name)
            )
            for name in found.continued
        }
        find_folders = partial(append_staging_folders, target)
        with building_folder(added, target, folder, find_folders, places, report_line) as journal:
            written = _write(added, scan, store, found, folder, places, journal, progress)
            if written.checks:
                report_line(convention_report.line(written.checks))
            refuse_unusable(scan if found.domains else added, strict)
            _publish(scan, written, folder, store, command)
        shutil.rmtree(folder, ignore_errors=True)
    counts = {name: len(written.stored[name]) for name in sorted(written.stored)}
    return Appended(counts, found.domains)


def _added_records(scan: Scan, found: Additions) -> dict[str, Sequence[InstanceRecord]]:
    """The records of new instances by trajectory."""

    def behind(records: Sequence[InstanceRecord], first: int) -> Sequence[InstanceRecord]:
        return LazySequence(len(records) - first, lambda row: records[first + row])

    continued = {n: behind(scan.trajectories[n], first) for n, first in found.continued.items()}
    return {name: scan.trajectories[name] for name in found.new} | continued


def _write(
    added: Scan,
    scan: Scan,
    store: Store,
    found: Additions,
    folder: Path,
    places: Mapping[str, FramePlace],
    journal: IngestJournal | None,
    progress: ReportProgress,
) -> _Written:
    """Write the frames of new domains and of new instances below `folder`.

    `places` are those of trajectories that are continued, with the depth types of stored domains.
    """
    domain_frames: DomainFrames = []
    if found.domains:
        domain_frames = write_domain_frames(
            scan, store, found.domains, found.rows, folder, progress
        )
    added_domains = [scan.domains[domain] for domain in found.domains]
    places = {
        name: replace(
            place, depth_types={**place.depth_types, **depth_types(folder, added_domains, name)}
        )
        for name, place in places.items()
    }
    stored = write_frames(added, folder, progress, places, journal) if added.trajectories else {}
    ends = {
        name: TrajectoryEnd.of(store, name, name in found.renumbered)
        for name in found.continued
        if name in stored
    }
    folders = {name: place.folder for name, place in places.items()}
    checks = convention_report.check_appended(added, stored, folder, folders)
    return _Written(stored, found.domains, domain_frames, ends, checks)


def _publish(scan: Scan, written: _Written, folder: Path, store: Store, command: str) -> None:
    """Move the frames from `folder` into the store, and publish their rows."""
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
        _insert_rows(draft, scan, written, store, command)


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
                        f"{root / trajectory.path}: a kept generation has these frames; remove it "
                        "by `s2r prune --keep`, or give the trajectory another name"
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
    draft: IndexTransaction, scan: Scan, written: _Written, store: Store, command: str
) -> None:
    parts = list(store.parts)
    if not draft.rows("SELECT 1 FROM part"):
        ingested_at = store.provenance("dataset").get("ingested_at")
        parts = [replace(parts[0], added_at=ingested_at)]
        draft.insert_row("part", _part_row(parts[0]))
    insert_domains(draft, scan, written.domains, written.domain_frames)
    facts: dict[str, Any] = {
        "command": command,
        "added_at": now(),
        "problems": problem_counts(scan),
    }
    for domain in written.domains:
        draft.set_provenance("dataset", {f"domain:{domain}": facts})
    stored, ends = written.stored, written.ends
    if stored:
        count, sha256 = sum(map(len, stored.values())), part_hash(scan, stored, ends)
        added = Part(len(parts), parts[-1].stop, count, sha256, facts["added_at"])
        draft.insert_row("part", _part_row(added))
        insert_instances(draft, scan, stored, added.first_iid, ends)
        checks = convention_report.appended_facts(written.checks, added.part)
        draft.set_provenance(schema.CONVENTIONS, checks)
        parts.append(added)
        counts = {name: len(stored[name]) for name in sorted(stored)}
        draft.set_provenance("dataset", {f"append:{added.part}": {**facts, "trajectories": counts}})
        for section, of_part in scan.part_provenance.items():
            draft.set_provenance(f"{section}:{added.part}", of_part)
    hashes = [part.hash for part in parts] + [row[0] for row in draft.rows(_DOMAIN_HASHES)]
    draft.update("dataset", {"hash": store.dataset.hash}, {"hash": dataset_hash(hashes)})


def _part_row(part: Part) -> dict[str, object]:
    return {name: getattr(part, name) for name in part.__slots__}
