"""A data set of one recording, whose instances have images of one side alone."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files.layout import checked_name
from s2rstore.geometry import angles
from s2rstore.records import Domain, Side
from s2rtools.common.lazy_sequence import LazySequence
from s2rtools.datasets.floor.floor_poses import (
    FloorOptions,
    FloorPoses,
    StoredFloor,
    project_to_floor,
    put_on_stored_floor,
)
from s2rtools.datasets.pairing import pair_facts
from s2rtools.datasets.pairing.pair_matching import Rows
from s2rtools.datasets.pairing.paired_recordings import (
    MapOptions,
    add_reports,
    empty_scan,
    frame_pose,
    frame_source,
    side_domain,
)
from s2rtools.datasets.pairing.recording_pairs import RecordedSide
from s2rtools.datasets.recording import Recording
from s2rtools.datasets.scan import InstanceRecord, Scan


@dataclass(frozen=True, slots=True, eq=False)
class RecordedScan:
    """The scan of one recording; `summary` holds lines for the user."""

    scan: Scan
    summary: list[str]


def scan_recording(
    recording: Recording,
    side: Side,
    floor: FloorOptions | None,
    options: MapOptions,
    stored_domain: Domain | None = None,
) -> RecordedScan:
    """Scan a recording as a data set that has images of one side alone.

    With `options.stored` it is appended to a store, whose domain of the side is `stored_domain`;
    the recording then lies in the world of the stored recordings of its side. Where the store has
    none of them but the domain, the x and y axes of the recording's world are those of the map (y
    negated where it grows downwards) and z points up. `floor` says how other poses are put on the
    floor. Raises RequestError where poses, cameras or options are not usable.
    """
    recorded = RecordedSide(side, recording, _floor(recording, side, floor, options, stored_domain))
    if not len(recorded):
        raise RequestError(f"{recording.name}: no image has a pose on the floor")
    stored = options.stored
    if stored is not None:
        if side == "sim" and stored.alignment is not None:
            recorded.poses = stored.alignment.apply(recorded.poses)
        if stored.y_down:
            recorded.poses = recorded.poses * (1, -1, 1)
            recorded.poses[:, 2] = angles.wrap(-recorded.poses[:, 2])
    scan = empty_scan(recording, recorded.poses, options)
    add_reports(scan, recorded)
    scan.domains = {side: side_domain(recorded, options.frame)}
    scan.part_provenance = pair_facts.recording_facts(recorded)
    for code, name in enumerate(recorded.names):
        numbers = np.flatnonzero(recorded.codes == code)
        scan.add_trajectory(checked_name(name, "trajectory"), _records(recorded, scan, numbers))
    lines = [f"{side} floor: {line}" for line in recorded.floor.report]
    return RecordedScan(scan, [*lines, f"{len(recorded)} {side} images"])


def _floor(
    recording: Recording,
    side: Side,
    floor: FloorOptions | None,
    options: MapOptions,
    domain: Domain | None,
) -> FloorPoses:
    if options.stored is None or domain is None:
        return project_to_floor(recording, floor)
    options.stored.check(side, recording, set(recording.trajectories))
    known = options.stored.floors.get(side)
    if known is None:
        height, pitch = domain.camera_height, domain.rgb.pitch
        known = StoredFloor(np.eye(4), 1.0, height, 0.0, pitch, 0.0)
    return put_on_stored_floor(recording, known, side)


def _records(side: RecordedSide, scan: Scan, numbers: Rows) -> LazySequence[InstanceRecord]:
    """The instances of some images, each with the image of one side."""

    def record(row: int) -> InstanceRecord:
        number = int(numbers[row])
        x, y, heading = side.poses[number].tolist()
        time = float(side.times[number])
        return InstanceRecord(
            x, y, heading,
            {side.side: frame_source(side, number, scan)},
            timestamp=time if math.isfinite(time) else None,
            frame_poses={side.side: frame_pose(side, number)},
        )  # fmt: skip

    return LazySequence(len(numbers), record)
