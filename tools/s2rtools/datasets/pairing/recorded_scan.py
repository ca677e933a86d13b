"""Data sets of recordings: their map, domains and instances; and data sets of one recording alone.

The instances of one recording have images of one side alone; see `paired_recordings` for two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rstore.files.documents import read_document
from s2rstore.files.layout import checked_name
from s2rstore.geometry import angles
from s2rstore.lazy_sequence import LazySequence
from s2rstore.records import Bounds, Domain, Intrinsics, Side
from s2rtools.datasets.dataset_config import DatasetConfig
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.floor.floor_poses import (
    FloorOptions,
    FloorPoses,
    StoredFloor,
    project_to_floor,
    put_on_stored_floor,
)
from s2rtools.datasets.pairing import pair_facts
from s2rtools.datasets.pairing.pair_matching import Floats, Rows
from s2rtools.datasets.pairing.recording_pairs import RecordedSide
from s2rtools.datasets.pairing.stored_worlds import StoredWorlds
from s2rtools.datasets.recording import Recording
from s2rtools.datasets.recordings.image_frame_source import ImageFrameSource
from s2rtools.datasets.scan import FramePose, InstanceRecord, Scan

MARGIN = 2.0
"""Metres of the map around the outermost poses, where no calibration file states the bounds."""
_MAX_RAW = 65535
_NO_CAMERA = Intrinsics(*[math.nan] * 5)


@dataclass(frozen=True, slots=True)
class MapOptions:
    """The (height, width) of frames, and the map of a data set of recordings.

    `calibration` is a file with bounds, rooms and floor plan; its cameras are not used. `stored`
    are the worlds of a store to which the recordings are appended.
    """

    frame: tuple[int, int]
    calibration: Path | None = None
    allow_outside: bool = False
    stored: StoredWorlds | None = None


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
    scan = scan_of_sides([recorded], [np.arange(len(recorded))], options)
    scan.part_provenance = pair_facts.recording_facts(recorded)
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


def scan_of_sides(sides: Sequence[RecordedSide], rows: Sequence[Rows], options: MapOptions) -> Scan:
    """The data set whose instances have the images `rows` (K,) of each side.

    Poses, times, trajectories and their order are those of the last side.
    """
    chosen = [side.poses[numbers] for side, numbers in zip(sides, rows, strict=True)]
    main = sides[-1]
    scan = _empty_scan(main.recording, np.concatenate(chosen), options)
    for side in sides:
        _add_reports(scan, side)
    floors = {side.side: f"--{side.side}-floor" if len(sides) > 1 else "--floor" for side in sides}
    scan.domains = {side.side: _domain(side, options.frame, floors[side.side]) for side in sides}
    codes = main.codes[rows[-1]]
    for code, name in enumerate(main.names):
        of_name = np.flatnonzero(codes == code)
        if of_name.size:
            record = partial(_record, scan, sides, [numbers[of_name] for numbers in rows])
            scan.add_trajectory(
                checked_name(name, "trajectory"), LazySequence(of_name.size, record)
            )
    return scan


def _record(
    scan: Scan, sides: Sequence[RecordedSide], rows: Sequence[Rows], row: int
) -> InstanceRecord:
    """The instance of a place in `rows`."""
    images = [(side, int(numbers[row])) for side, numbers in zip(sides, rows, strict=True)]
    main, number = images[-1]
    x, y, heading = main.poses[number].tolist()
    time = float(main.times[number])
    return InstanceRecord(
        x, y, heading,
        {side.side: _frame_source(side, number) for side, number in images},
        timestamp=time if math.isfinite(time) else None,
        frame_poses={side.side: _frame_pose(side, number) for side, number in images},
    )  # fmt: skip


def _empty_scan(recording: Recording, poses: Floats, options: MapOptions) -> Scan:
    """The data set of a recording without domains and trajectories.

    Its bounds are those of the calibration file or of the store, else those of `poses` (N, 3).
    """
    root = recording.root
    if options.calibration is not None:
        _refuse_camera(options.calibration)
        config = DatasetConfig(options.calibration, name=recording.name, y_down=False)
        containment = PathContainment(config.path.parent, options.allow_outside)
        if config.table.y_down:
            raise RequestError(
                f"{config.path}: y_down = true; on the floor of recordings y grows upwards"
            )
        return config.empty_scan(root, options.frame, containment)
    name, stored = recording.name, options.stored
    if stored is not None:
        bounds, scale = stored.bounds, stored.accuracy_scale
        return Scan(name, root, options.frame, stored.y_down, bounds, scale, ())
    (x0, y0), (x1, y1) = poses[:, :2].min(axis=0) - MARGIN, poses[:, :2].max(axis=0) + MARGIN
    bounds = Bounds(float(x0), float(y0), float(x1), float(y1))
    return Scan(name, root, options.frame, False, bounds, bounds.diagonal, ())


def _refuse_camera(path: Path) -> None:
    """Raise RequestError for a file that describes a camera, as layout csv takes it."""
    document = read_document(path)
    if isinstance(document, dict) and "camera" in document:
        raise RequestError(
            f"{path}: describes a camera, but --calibration (--header) names a file with bounds, "
            "rooms and floor plan; name that of a camera by --sim-option or --real-option "
            "camera=FILE"
        )


def _add_reports(scan: Scan, side: RecordedSide) -> None:
    """Add the issues of a recording and of its floor, and the folders that it was read from."""
    issues = [*side.recording.issues, *side.floor.issues]
    scan.issues += [issue.of_side(side.side) for issue in issues]
    counts = dict(scan.outside_folders)
    for folder, count in side.recording.outside_folders.items():
        counts[folder] = counts.get(folder, 0) + count
    scan.outside_folders = counts


def _domain(side: RecordedSide, frame: tuple[int, int], floor_option: str) -> Domain:
    """The domain of one side. Raises RequestError where depth cannot be put on the floor.

    `floor_option` is the option that says how poses are put on the floor.
    """
    recording, floor = side.recording, side.floor
    has_depth = any(
        each.depth is not None
        for trajectory in recording.trajectories.values()
        for each in trajectory.frames
    )
    if has_depth and not math.isfinite(floor.camera_height):
        raise RequestError(
            f"{recording.layout}:{recording.name}: the height of the camera above the floor is not "
            f"known; give {floor_option} camera_height=METRES"
        )
    depth, scale, raw_max = _NO_CAMERA, math.nan, 0
    if has_depth:
        depth = recording.camera_of_depth.intrinsics(frame, floor.pitch)
        scale = recording.metres_of_depth(floor.metres_per_unit)
        raw_max = min(recording.depth_raw_max, _MAX_RAW)
    return Domain(
        domain=side.side,
        kind=side.side,
        rgb=recording.camera.intrinsics(frame, floor.pitch),
        depth=depth,
        camera_height=floor.camera_height,
        forward_offset=0.0,
        depth_scale=scale,
        depth_raw_min=1,
        depth_raw_max=raw_max,
        sources={"intrinsics": "declared", "camera_height": "estimated", "pitch": "estimated"},
        has_depth=has_depth,
    )


def _frame_source(side: RecordedSide, number: int) -> ImageFrameSource:
    """The frame source of one image of a recording."""
    recording, frame = side.recording, side.frame(number)
    return ImageFrameSource(frame, recording.camera, recording.camera_of_depth, side.side)


def _frame_pose(side: RecordedSide, number: int) -> FramePose:
    """The pose of an image on the map, and that of its camera in the recording's world."""
    x, y, heading = side.poses[number].tolist()
    pose = side.camera_pose(number)
    position = (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3]))
    a, b, c, d = (float(each) for each in Rotation.from_matrix(pose[:3, :3]).as_quat())
    return FramePose(x, y, heading, (*position, a, b, c, d))
