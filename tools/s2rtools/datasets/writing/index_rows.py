"""Index rows of a new store or of appended instances, from a scan and its stored frames."""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.curvature import REACH, curvature
from s2rstore.geometry.rooms import room_codes
from s2rstore.index import schema
from s2rstore.index.row_records import CAMERA_COLUMNS, DEPTH_COLUMNS
from s2rstore.index.transaction import IndexTransaction
from s2rstore.reader import Store
from s2rstore.records import Domain
from s2rtools.datasets.scan import FramePose, InstanceRecord, Scan, StoredRecords, StoredTrajectory

_POSE_COLUMNS = schema.BY_NAME["frame_pose"].column_names[2:]
_BLOCK = 2048
"""Rows that are inserted together."""


def write_index(
    draft: IndexTransaction, scan: Scan, stored: StoredRecords, plan: str | None, command: str
) -> None:
    """Fill the tables of a new store; iids follow trajectory name, then recording order."""
    draft.insert_row("dataset", _dataset_row(scan, stored, plan))
    insert_instances(draft, scan, stored, 0)
    for room in scan.rooms:
        draft.insert_row("room", asdict(room))
    for domain in scan.domains.values():
        insert_domain(draft, domain, scan.has_poses)
    facts = {"command": command, "ingested_at": now(), "problems": problem_counts(scan)}
    draft.set_provenance("dataset", facts)
    for section, facts in (scan.provenance | scan.part_provenance).items():
        draft.set_provenance(section, facts)


def insert_domain(
    draft: IndexTransaction, domain: Domain, has_poses: bool, sha256: str | None = None
) -> None:
    """Insert a domain; `sha256` is the hash of one that is added to stored instances."""
    row = {k: v for k, v in asdict(domain).items() if not isinstance(v, dict)}
    for image in ("rgb", "depth"):
        row |= {f"{image}_{name}": v for name, v in asdict(getattr(domain, image)).items()}
    if not domain.has_depth:
        row |= dict.fromkeys(DEPTH_COLUMNS)
    if not has_poses:
        row |= dict.fromkeys((*CAMERA_COLUMNS, "has_depth"))
    draft.insert_row("domain", {**row, "source": domain.sources, "hash": sha256})


@dataclass(frozen=True, slots=True)
class TrajectoryEnd:
    """The end of a stored trajectory, behind which further instances are inserted.

    `instances` is their number. `seq` is the number of the next one where `counts_on`, else it is
    that of its source; sources without numbers count on as well. `iids` and `headings` (k,)
    are those of the last instances: all whose curvature depends on the next ones, and all on which
    the curvature of these and of the next ones depends.
    """

    instances: int
    seq: int
    iids: NDArray[np.int64]
    headings: NDArray[np.float64]
    counts_on: bool = False

    @classmethod
    def of(cls, store: Store, trajectory: str, counts_on: bool = False) -> TrajectoryEnd:
        iids, truth = store.iids_of(trajectory), store.instances
        last = iids[-2 * REACH :]
        return cls(iids.size, int(truth.seq[last[-1]]) + 1, last, truth.heading[last], counts_on)

    def insert_behind(self, draft: IndexTransaction, name: str, added: StoredTrajectory) -> None:
        """Count the instances of the trajectory, and correct the curvature of its last ones."""
        count = self.instances + len(added)
        draft.update("trajectory", {"trajectory": name}, {"instances": count})
        values = self.curvatures(added)[: self.iids.size]
        for iid, value in list(zip(self.iids.tolist(), values.tolist(), strict=True))[-REACH:]:
            if not math.isnan(value):
                draft.update("instance", {"iid": iid}, {"curvature": value})

    def curvatures(self, added: StoredTrajectory) -> NDArray[np.float64]:
        """The curvature of the last stored instances and the added ones, degrees.

        That of the first `REACH` ones is right only where no instance precedes them.
        """
        return curvature(np.concatenate([self.headings, added.headings()]))


def insert_instances(
    draft: IndexTransaction,
    scan: Scan,
    stored: StoredRecords,
    first_iid: int,
    ends: Mapping[str, TrajectoryEnd] | None = None,
) -> None:
    """Insert instances, their frames and trajectories.

    They get the iids from `first_iid` on, by trajectory name, then in recording order. `ends` are
    those of the trajectories that have instances already.
    """
    ends = ends or {}
    for name in sorted(stored):
        if name in ends:
            ends[name].insert_behind(draft, name, stored[name])
            continue
        row = {"recorded_at": scan.recorded_at.get(name), "instances": len(stored[name])}
        draft.insert_row("trajectory", {"trajectory": name, **row})
    room_names = list(dict.fromkeys(room.room for room in scan.rooms))
    iid = first_iid
    for name, trajectory in sorted(stored.items()):
        end = ends.get(name)
        if end is None:
            curvatures = curvature(trajectory.headings())
        else:
            curvatures = end.curvatures(trajectory)[end.iids.size :]
        for start in range(0, len(trajectory), _BLOCK):
            records = trajectory.records(start, start + _BLOCK)
            columns = _instance_columns(scan, records, room_names)
            rows = np.arange(start, start + len(records), dtype=np.int32)
            draft.insert(
                "instance",
                {
                    "iid": iid + rows,
                    "trajectory": np.full(len(records), name, dtype=object),
                    "seq": np.array(
                        [_seq(r, row, end) for row, r in enumerate(records, start)], dtype=np.int32
                    ),
                    **columns,
                    "curvature": curvatures[start : start + _BLOCK],
                },
            )
        iid += len(trajectory)
    for domain in scan.domains:
        iid = first_iid
        for _, trajectory in sorted(stored.items()):
            insert_frames(draft, scan, trajectory, domain, iid)
            iid += len(trajectory)


def _seq(record: InstanceRecord, position: int, end: TrajectoryEnd | None) -> int:
    """The number of an instance in its trajectory: that of its source, else its position.

    `position` counts from 0, behind `end` where the trajectory has instances already.
    """
    if record.seq is None or (end is not None and end.counts_on):
        return position if end is None else end.seq + position
    return record.seq


def insert_frames(
    draft: IndexTransaction, scan: Scan, trajectory: StoredTrajectory, domain: str, first_iid: int
) -> None:
    """Insert the frames of a trajectory in a domain, if the domain images it."""
    for start in range(0, len(trajectory), _BLOCK):
        records = trajectory.records(start, start + _BLOCK)
        if domain not in records[0].sources:
            return
        files = [record.sources[domain].file_names(scan) for record in records]
        rows = range(start, start + len(records))
        checksums = [trajectory.checksum(domain, row) for row in rows]
        draft.insert(
            "frame",
            {
                "iid": np.arange(len(records), dtype=np.int32) + first_iid + start,
                "domain": np.full(len(records), domain, dtype=object),
                "rgb_path": [rgb for rgb, _ in files],
                "depth_path": [depth for _, depth in files],
                "sha256": [checksum.sha256 for checksum in checksums],
                "valid_depth_fraction": [checksum.valid_fraction for checksum in checksums],
            },
        )
        if records[0].frame_poses:
            poses = np.array([_pose_row(record.frame_poses[domain]) for record in records])
            draft.insert(
                "frame_pose",
                {
                    "iid": np.arange(len(records), dtype=np.int32) + first_iid + start,
                    "domain": np.full(len(records), domain, dtype=object),
                    **dict(zip(_POSE_COLUMNS, poses.T, strict=True)),
                },
            )


def _pose_row(pose: FramePose) -> tuple[float, ...]:
    return pose.x, pose.y, pose.heading, *pose.camera


def now() -> str:
    """The time, UTC, as the index states it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def problem_counts(scan: Scan) -> dict[str, int]:
    """The number of issues of each kind."""
    return Counter(issue.kind for issue in scan.issues)


def part_hash(
    scan: Scan, stored: StoredRecords, ends: Mapping[str, TrajectoryEnd] | None = None
) -> str:
    """SHA-256 over the poses and frames of instances, and over the data set's calibration.

    `ends` are those of the trajectories that have instances already. It is the hash of a JSON
    document that is made piece by piece.
    """
    facts = {
        "frame": scan.frame,
        "y_down": scan.y_down,
        "accuracy_scale": scan.accuracy_scale,
        "bounds": asdict(scan.bounds),
        "rooms": [asdict(room) for room in scan.rooms],
        "domains": [domain.facts() for domain in scan.domains.values()],
        "rows": [],
    }
    before, after = json.dumps(facts, sort_keys=True).split('"rows": []')
    digest = hashlib.sha256(f'{before}"rows": ['.encode())
    separator = ""
    for name in sorted(stored):
        end = ends.get(name) if ends else None
        for position, (r, checksums) in enumerate(stored[name]):
            seq = _seq(r, position, end)
            row = [name, seq, r.x, r.y, r.heading, {d: c.sha256 for d, c in checksums.items()}]
            if r.frame_poses:
                row.append({d: (p.x, p.y, p.heading) for d, p in r.frame_poses.items()})
            digest.update((separator + json.dumps(row, sort_keys=True)).encode())
            separator = ", "
    digest.update(f"]{after}".encode())
    return digest.hexdigest()


def domain_hash(scan: Scan, domain: str, stored: Iterable[StoredTrajectory]) -> str:
    """SHA-256 over the frames of a domain that is added to stored instances, and its calibration.

    `stored` are those of all instances of the store, in the order of their iids.
    """
    facts = [scan.frame, scan.domains[domain].facts()]
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for trajectory in stored:
        for row in range(len(trajectory)):
            digest.update(bytes.fromhex(trajectory.checksum(domain, row).sha256))
    return digest.hexdigest()


def dataset_hash(hashes: Sequence[str]) -> str:
    """The hash of a data set that was appended to: SHA-256 over hashes, joined in order.

    They are those of its parts, then those of the domains that were added to them, by name.
    """
    return hashlib.sha256("".join(hashes).encode()).hexdigest()


def _dataset_row(scan: Scan, stored: StoredRecords, plan: str | None) -> dict[str, Any]:
    edges = {f"bounds_{name}": value for name, value in asdict(scan.bounds).items()}
    return {
        "name": scan.name,
        "hash": part_hash(scan, stored),
        **edges,
        "y_down": scan.y_down,
        "floor_plan": plan,
        "accuracy_scale": scan.accuracy_scale,
        "frame_height": scan.frame[0],
        "frame_width": scan.frame[1],
        "has_poses": scan.has_poses,
        "recall_thresholds": scan.recall_thresholds and json.dumps(scan.recall_thresholds),
    }


def _instance_columns(
    scan: Scan, records: list[InstanceRecord], room_names: list[str]
) -> dict[str, Any]:
    """Poses, rooms, odometry and time of some instances."""
    x, y, heading = (np.array([getattr(r, k) for r in records]) for k in ("x", "y", "heading"))
    codes = room_codes(x, y, scan.rooms, room_names)
    missing = (np.nan, np.nan, np.nan)
    offsets = np.array([record.pair_offset for record in records])
    odometry = np.array([r.odometry or missing for r in records], dtype=np.float64)
    return {
        "x": x,
        "y": y,
        "heading": heading,
        "room": [room_names[code] if code >= 0 else None for code in codes],
        "odom_x": odometry[:, 0],
        "odom_y": odometry[:, 1],
        "odom_heading": odometry[:, 2],
        "timestamp": np.array([np.nan if r.timestamp is None else r.timestamp for r in records]),
        **dict(zip(schema.PAIR_OFFSETS, offsets.T, strict=True)),
    }
