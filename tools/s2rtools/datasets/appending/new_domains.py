"""Add images in further domains to stored instances: frames, index rows and hashes."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from s2rstore.arrays import stored_array
from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.index.transaction import IndexTransaction
from s2rstore.lazy_sequence import LazySequence
from s2rstore.reader import Store
from s2rstore.records import Domain, TrajectoryPart
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.appending.instance_agreement import stored_depth_types
from s2rtools.datasets.scan import InstanceRecord, Scan, StoredTrajectory
from s2rtools.datasets.writing.frame_writing import FramePlace, ReportProgress, write_trajectory
from s2rtools.datasets.writing.index_rows import (
    dataset_hash,
    domain_hash,
    insert_domain,
    insert_frames,
)

DomainFrames = list[tuple[TrajectoryPart, StoredTrajectory]]
"""The stored frames of new domains, for each part of a trajectory in the order of the iids."""


def write_domain_frames(
    scan: Scan,
    store: Store,
    domains: Sequence[str],
    rows: Mapping[str, array[int]],
    root: Path,
    progress: ReportProgress,
) -> DomainFrames:
    """Write the frames of domains for the stored instances that the scan has in them.

    They are written below `root`. `rows` are the numbers of the records of a trajectory's stored
    instances. Raises RequestError where a frame is unusable.
    """
    written: DomainFrames = []
    for part in store.trajectory_parts:
        name = part.trajectory
        imaged = [
            each
            for each in domains
            if name in rows
            and each in scan.trajectories[name][0].sources
            and part not in store.imaged_parts.get(each, ())
        ]
        if not imaged:
            continue
        records = _records(scan, imaged, part, rows[name])
        types = stored_depth_types(store, name)
        if part.row:
            types |= depth_types(root, [scan.domains[each] for each in imaged], name)
        place = FramePlace(part.folder, types)
        before = len(scan.issues)
        of_part = replace(scan, trajectories={name: records})
        stored = write_trajectory(of_part, root, name, progress, place)
        if stored is None or len(stored) != part.instances:
            issue = _of_left_out(scan, scan.issues[before:], stored)
            raise RequestError(
                f"{issue.file}: {issue.kind} {issue.detail}".rstrip()
                + f"; domain {', '.join(imaged)} needs an image of every instance of "
                f"trajectory {name} of {store.path}"
            )
        written.append((part, stored))
    return written


def _of_left_out(
    scan: Scan, issues: Sequence[InputIssue], stored: StoredTrajectory | None
) -> InputIssue:
    """The first issue of a record that was left out; stored records have issues, too."""
    records = [] if stored is None else stored.records()
    sources = (source for record in records for source in record.sources.values())
    kept = {file for source in sources for file in source.file_names(scan)}
    return next((issue for issue in issues if issue.file not in kept), issues[0])


def insert_domains(
    draft: IndexTransaction, scan: Scan, domains: Sequence[str], written: DomainFrames
) -> None:
    """Insert domains that are new, and the rows of the frames of all."""
    for name in domains:
        imaged = [(part, stored) for part, stored in written if name in stored.domains]
        sha256 = domain_hash(scan, name, (stored for _, stored in imaged)) if imaged else None
        before = draft.rows("SELECT hash FROM domain WHERE domain = ?", [name])
        if not before:
            insert_domain(draft, scan.domains[name], scan.has_poses, sha256)
        else:
            hashes = [each for each in (before[0][0], sha256) if each]
            draft.update("domain", {"domain": name}, {"hash": dataset_hash(hashes)})
        for part, stored in imaged:
            insert_frames(draft, scan, stored, name, part.first_iid)


def _records(
    scan: Scan, domains: Sequence[str], part: TrajectoryPart, rows: array[int]
) -> Sequence[InstanceRecord]:
    """The records of a part's instances, with their sources in some domains alone."""
    records = scan.trajectories[part.trajectory]

    def record(row: int) -> InstanceRecord:
        whole = records[rows[part.row + row]]
        return replace(whole, sources={name: whole.sources[name] for name in domains})

    return LazySequence(part.instances, record)


def depth_types(root: Path, domains: Sequence[Domain], trajectory: str) -> dict[str, str]:
    """The numpy type of a trajectory's depth images that are written below `root`, by domain."""
    folders = {
        each.domain: root / layout.FRAMES / each.domain / trajectory / "depth"
        for each in domains
        if each.has_depth
    }
    return {
        name: stored_array.open_read(folder, root).layout.dtype
        for name, folder in folders.items()
        if folder.is_dir()
    }
