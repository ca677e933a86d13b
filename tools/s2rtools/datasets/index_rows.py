"""The rows of a new store's index, from a scan and the views that were kept."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Any

import numpy as np

from s2rstore.geometry.rooms import room_codes
from s2rstore.geometry.trajectory import curvature
from s2rstore.index.transaction import IndexTransaction
from s2rstore.metrics import bootstrap
from s2rstore.records import Domain
from s2rtools.datasets.scan import FrameChecksum, InstanceRecord, Scan

Kept = dict[str, list[tuple[InstanceRecord, dict[str, FrameChecksum]]]]
Row = tuple[str, int, InstanceRecord, dict[str, FrameChecksum]]


def write_index(
    draft: IndexTransaction, scan: Scan, kept: Kept, plan: str | None, command: str
) -> None:
    """Fill the tables of a new store: iids count in order of trajectory name, then recording."""
    names = sorted(kept)
    rows = [(name, seq, *row) for name in names for seq, row in enumerate(kept[name])]
    sightings = [sighting for _, _, sighting, _ in rows]
    draft.insert_row("dataset", _dataset_row(scan, rows, plan))
    for name in names:
        draft.insert_row(
            "trajectory",
            {"trajectory": name, "recorded_at": scan.recorded_at.get(name),
             "instances": len(kept[name])},
        )  # fmt: skip
    for room in scan.rooms:
        draft.insert_row("room", asdict(room))
    for domain in scan.domains.values():
        draft.insert_row("domain", _domain_row(domain))
    draft.insert("instance", _instance_columns(scan, rows))
    for name in scan.domains:
        draft.insert(
            "frame",
            {
                "iid": np.arange(len(rows), dtype=np.int32),
                "domain": np.full(len(rows), name, dtype=object),
                "rgb_path": [s.images[name].files(scan)[0] for s in sightings],
                "depth_path": [s.images[name].files(scan)[1] for s in sightings],
                "sha256": [facts[name].sha256 for *_, facts in rows],
                "valid_depth_fraction": [facts[name].valid_fraction for *_, facts in rows],
            },
        )
    problems: dict[str, int] = {}
    for problem in scan.problems:
        problems[problem.kind] = problems.get(problem.kind, 0) + 1
    draft.note(
        "dataset",
        {"command": command, "ingested_at": datetime.now(UTC).isoformat(timespec="seconds"),
         "problems": problems},
    )  # fmt: skip
    for what, facts in scan.notes.items():
        draft.note(what, facts)
    rule = "block_length 0: the rounded-up square root of n, in recording order"
    draft.note("statistics", {"bootstrap": {**asdict(bootstrap.DEFAULT_SETTINGS), "rule": rule}})


def _dataset_row(scan: Scan, rows: list[Row], plan: str | None) -> dict[str, Any]:
    facts = {
        "frame": scan.frame,
        "y_down": scan.y_down,
        "accuracy_scale": scan.accuracy_scale,
        "bounds": asdict(scan.bounds),
        "rooms": [asdict(room) for room in scan.rooms],
        "domains": [asdict(domain) for domain in scan.domains.values()],
        "rows": [
            (name, seq, s.x, s.y, s.heading, {d: f.sha256 for d, f in facts.items()})
            for name, seq, s, facts in rows
        ],
    }
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()
    edges = {f"bounds_{name}": value for name, value in asdict(scan.bounds).items()}
    return {
        "name": scan.name,
        "hash": digest,
        **edges,
        "y_down": scan.y_down,
        "floor_plan": plan,
        "accuracy_scale": scan.accuracy_scale,
        "frame_height": scan.frame[0],
        "frame_width": scan.frame[1],
    }


def _domain_row(domain: Domain) -> dict[str, Any]:
    row = {key: value for key, value in asdict(domain).items() if not isinstance(value, dict)}
    for image in ("rgb", "depth"):
        row |= {f"{image}_{name}": v for name, v in asdict(getattr(domain, image)).items()}
    return {**row, "source": domain.sources}


def _instance_columns(scan: Scan, rows: list[Row]) -> dict[str, Any]:
    sightings: list[InstanceRecord] = [sighting for _, _, sighting, _ in rows]
    names = np.array([name for name, *_ in rows], dtype=object)
    x, y, heading = (np.array([getattr(s, k) for s in sightings]) for k in ("x", "y", "heading"))
    bend = np.zeros(len(rows))
    for name in dict.fromkeys(names):
        bend[names == name] = curvature(heading[names == name])
    room_names = list(dict.fromkeys(room.room for room in scan.rooms))
    codes = room_codes(x, y, scan.rooms, room_names)
    missing = (np.nan, np.nan, np.nan)
    odometry = np.array([s.odometry or missing for s in sightings], dtype=np.float64)
    return {
        "iid": np.arange(len(rows), dtype=np.int32),
        "trajectory": names,
        "seq": np.array([seq for _, seq, *_ in rows], dtype=np.int32),
        "x": x,
        "y": y,
        "heading": heading,
        "room": [room_names[code] if code >= 0 else None for code in codes],
        "curvature": bend,
        "odom_x": odometry[:, 0],
        "odom_y": odometry[:, 1],
        "odom_heading": odometry[:, 2],
        "timestamp": np.array([np.nan if s.timestamp is None else s.timestamp for s in sightings]),
    }
