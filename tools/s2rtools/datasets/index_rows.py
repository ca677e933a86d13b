"""Index rows of a new store or of appended instances, from a scan and its stored frames."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import numpy as np

from s2rstore.geometry.curvature import curvature
from s2rstore.geometry.rooms import room_codes
from s2rstore.index.row_check import CAMERA_COLUMNS
from s2rstore.index.transaction import IndexTransaction
from s2rstore.metrics import bootstrap
from s2rtools.datasets.scan import FrameChecksum, InstanceRecord, Scan

StoredRecords = dict[str, list[tuple[InstanceRecord, dict[str, FrameChecksum]]]]
InstanceRow = tuple[str, int, InstanceRecord, dict[str, FrameChecksum]]


def write_index(
    draft: IndexTransaction, scan: Scan, stored: StoredRecords, plan: str | None, command: str
) -> None:
    """Fill the tables of a new store; iids follow trajectory name, then recording order."""
    rows = instance_rows(stored)
    draft.insert_row("dataset", _dataset_row(scan, rows, plan))
    insert_instances(draft, scan, rows, 0)
    for room in scan.rooms:
        draft.insert_row("room", asdict(room))
    for domain in scan.domains.values():
        row = {k: v for k, v in asdict(domain).items() if not isinstance(v, dict)}
        for image in ("rgb", "depth"):
            row |= {f"{image}_{name}": v for name, v in asdict(getattr(domain, image)).items()}
        if not scan.has_poses:
            row |= dict.fromkeys(CAMERA_COLUMNS)
        draft.insert_row("domain", {**row, "source": domain.sources})
    facts = {"command": command, "ingested_at": now(), "problems": problem_counts(scan)}
    draft.set_provenance("dataset", facts)
    for section, facts in scan.provenance.items():
        draft.set_provenance(section, facts)
    rule = "block_length 0: the rounded-up square root of n, in recording order"
    draft.set_provenance(
        "statistics", {"bootstrap": {**asdict(bootstrap.DEFAULT_SETTINGS), "rule": rule}}
    )


def instance_rows(stored: StoredRecords) -> list[InstanceRow]:
    """The instances by trajectory name, then in recording order."""
    return [(name, seq, *row) for name in sorted(stored) for seq, row in enumerate(stored[name])]


def insert_instances(
    draft: IndexTransaction, scan: Scan, rows: list[InstanceRow], first_iid: int
) -> None:
    """Insert instances, which get the iids from `first_iid` on, their frames and trajectories."""
    counts = Counter(name for name, *_ in rows)
    for name, count in counts.items():
        draft.insert_row(
            "trajectory",
            {"trajectory": name, "recorded_at": scan.recorded_at.get(name), "instances": count},
        )
    draft.insert("instance", _instance_columns(scan, rows, first_iid))
    for name in scan.domains:
        imaged = [
            (iid, *row[2:]) for iid, row in enumerate(rows, first_iid) if name in row[2].sources
        ]
        draft.insert(
            "frame",
            {
                "iid": np.array([iid for iid, *_ in imaged], dtype=np.int32),
                "domain": np.full(len(imaged), name, dtype=object),
                "rgb_path": [r.sources[name].file_names(scan)[0] for _, r, _ in imaged],
                "depth_path": [r.sources[name].file_names(scan)[1] for _, r, _ in imaged],
                "sha256": [checksums[name].sha256 for *_, checksums in imaged],
                "valid_depth_fraction": [c[name].valid_fraction for *_, c in imaged],
            },
        )


def now() -> str:
    """The time, UTC, as the index states it."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def problem_counts(scan: Scan) -> dict[str, int]:
    """The number of issues of each kind."""
    return Counter(issue.kind for issue in scan.issues)


def part_hash(scan: Scan, rows: list[InstanceRow]) -> str:
    """SHA-256 over the poses and frames of instances, and over the data set's calibration."""
    facts = {
        "frame": scan.frame,
        "y_down": scan.y_down,
        "accuracy_scale": scan.accuracy_scale,
        "bounds": asdict(scan.bounds),
        "rooms": [asdict(room) for room in scan.rooms],
        "domains": [asdict(domain) for domain in scan.domains.values()],
        "rows": [
            (name, seq, r.x, r.y, r.heading, {d: c.sha256 for d, c in checksums.items()})
            for name, seq, r, checksums in rows
        ],
    }
    return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()


def dataset_hash(part_hashes: list[str]) -> str:
    """The hash of a data set of several parts: SHA-256 over their hashes, joined in order."""
    return hashlib.sha256("".join(part_hashes).encode()).hexdigest()


def _dataset_row(scan: Scan, rows: list[InstanceRow], plan: str | None) -> dict[str, Any]:
    edges = {f"bounds_{name}": value for name, value in asdict(scan.bounds).items()}
    return {
        "name": scan.name,
        "hash": part_hash(scan, rows),
        **edges,
        "y_down": scan.y_down,
        "floor_plan": plan,
        "accuracy_scale": scan.accuracy_scale,
        "frame_height": scan.frame[0],
        "frame_width": scan.frame[1],
        "has_poses": scan.has_poses,
    }


def _instance_columns(scan: Scan, rows: list[InstanceRow], first_iid: int) -> dict[str, Any]:
    records = [record for _, _, record, _ in rows]
    names = np.array([name for name, *_ in rows], dtype=object)
    x, y, heading = (np.array([getattr(r, k) for r in records]) for k in ("x", "y", "heading"))
    curvatures = np.zeros(len(rows))
    for name in dict.fromkeys(names):
        curvatures[names == name] = curvature(heading[names == name])
    room_names = list(dict.fromkeys(room.room for room in scan.rooms))
    codes = room_codes(x, y, scan.rooms, room_names)
    missing = (np.nan, np.nan, np.nan)
    odometry = np.array([r.odometry or missing for r in records], dtype=np.float64)
    return {
        "iid": np.arange(first_iid, first_iid + len(rows), dtype=np.int32),
        "trajectory": names,
        "seq": np.array([seq for _, seq, *_ in rows], dtype=np.int32),
        "x": x,
        "y": y,
        "heading": heading,
        "room": [room_names[code] if code >= 0 else None for code in codes],
        "curvature": curvatures,
        "odom_x": odometry[:, 0],
        "odom_y": odometry[:, 1],
        "odom_heading": odometry[:, 2],
        "timestamp": np.array([np.nan if r.timestamp is None else r.timestamp for r in records]),
    }
