"""A data set of pairs from two recordings, one of the sim and one of the real side."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_document
from s2rstore.files.layout import checked_name
from s2rstore.records import Bounds, Domain, Intrinsics, Side
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.lazy_sequence import LazySequence
from s2rtools.datasets.dataset_config import DatasetConfig
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.floor.floor_alignment import FloorAlignment, fit_alignment
from s2rtools.datasets.floor.floor_poses import (
    FittedScale,
    FloorOptions,
    FloorPoses,
    project_to_floor,
    put_on_stored_floor,
)
from s2rtools.datasets.pairing import pair_facts
from s2rtools.datasets.pairing.pair_matching import PoseTolerance, ReportProgress, Rows
from s2rtools.datasets.pairing.recording_pairs import (
    Match,
    Pairing,
    RecordedSide,
    UnmatchedImage,
    pair_images,
    paired,
    unmatched_images,
)
from s2rtools.datasets.pairing.stored_worlds import StoredWorlds
from s2rtools.datasets.recording import Recording
from s2rtools.datasets.recordings.recorded_frame_source import RecordedFrameSource
from s2rtools.datasets.scan import FramePose, InstanceRecord, Scan

MARGIN = 2.0
"""Metres of the map around the outermost poses, where no calibration file states the bounds."""
_MAX_RAW = 65535
_NO_CAMERA = Intrinsics(*[math.nan] * 5)


@dataclass(frozen=True, slots=True)
class PairOptions:
    """How two recordings become a data set.

    `tolerance` is that of `recording_pairs.parse_tolerance`. With `align`, the floor of the sim
    recording is fitted to that of the real one by the pairs, which then are those of times or
    names. `floors` say how poses are put on the floor. `calibration` is a file with bounds, rooms
    and floor plan; its cameras are not used. `stored` are the worlds of a store to which the pairs
    are appended; `floors` are not used then, and `align` needs an alignment in the store.
    """

    match: Match
    tolerance: PoseTolerance | float | None
    frame: tuple[int, int]
    align: bool = False
    floors: Mapping[Side, FloorOptions] = field(default_factory=dict)
    calibration: Path | None = None
    allow_outside: bool = False
    stored: StoredWorlds | None = None


@dataclass(frozen=True, slots=True, eq=False)
class PairedScan:
    """The scan of a paired data set, and how it was paired.

    `summary` holds lines for the user. `unmatched` are the images without partner.
    """

    scan: Scan
    sim: RecordedSide
    real: RecordedSide
    pairing: Pairing
    unmatched: list[UnmatchedImage]
    summary: list[str]

    def write_report(self, path: Path) -> None:
        """Write a CSV file with a row per pair and per image without partner.

        Raises RequestError where the file cannot be written.
        """
        columns = ("status", "sim", "real", "offset_m", "offset_deg", "offset_s")
        try:
            with path.open("w", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(columns)
                pairs = self.pairing
                rows = zip(pairs.sim.tolist(), pairs.real.tolist(), pairs.metres.tolist(),
                           pairs.degrees.tolist(), pairs.seconds.tolist(), strict=True)  # fmt: skip
                for sim, real, *offsets in rows:
                    names = self.sim.image(sim), self.real.image(real)
                    writer.writerow(["pair", *names, *_numbers(offsets)])
                for each in self.unmatched:
                    is_sim = each.side == "sim"
                    names = (each.image, each.nearest) if is_sim else (each.nearest, each.image)
                    offsets = [each.metres, each.degrees, each.seconds]
                    writer.writerow([f"unmatched {each.side}", *names, *_numbers(offsets)])
        except OSError as error:
            raise RequestError(f"{path}: cannot be written ({error.strerror})") from error


def _numbers(values: list[float]) -> list[str]:
    return [f"{value:.6g}" if math.isfinite(value) else "" for value in values]


def scan_pairs(
    sim: Recording,
    real: Recording,
    options: PairOptions,
    progress: ReportProgress = lambda images: None,
) -> PairedScan:
    """Pair two recordings; the pose, trajectory and time of an instance are those of the real side.

    `progress` is called with numbers of images that are compared. Raises RequestError where there
    is no pair, or where poses, cameras or options are not usable.
    """
    if options.stored is not None:
        return _scan_further_pairs(sim, real, options, options.stored, progress)
    if options.align and options.match == "pose":
        raise RequestError("--align: the worlds differ; pair by --match time or --match name")
    worlds = _several_worlds(sim, real)
    if options.align and worlds:
        advice = "choose one by --sim-trajectory and --real-trajectory"
        raise RequestError(f"--align: {worlds[0].file}: {worlds[0].detail}; {advice}")
    floors = _floors(sim, real, options)
    sides = RecordedSide("sim", sim, floors["sim"]), RecordedSide("real", real, floors["real"])
    pairing = pair_images(*sides, options.match, options.tolerance, progress)
    alignment = None
    if options.align:
        poses = sides[0].poses[pairing.sim], sides[1].poses[pairing.real]
        alignment = fit_alignment(*poses, with_scale=not sim.is_metric)
        if not sim.is_metric:
            scale = FittedScale(floors["sim"], alignment.scale)
            floors["sim"] = project_to_floor(sim, options.floors.get("sim"), scale)
            sides = RecordedSide("sim", sim, floors["sim"]), sides[1]
            alignment = replace(alignment, scale=1.0)
        sides[0].poses = alignment.apply(sides[0].poses)
        pairing = paired(*sides, pairing.sim, pairing.real, pairing.issues)
    return _paired_scan(sides, pairing, options, alignment, worlds)


def _scan_further_pairs(
    sim: Recording,
    real: Recording,
    options: PairOptions,
    stored: StoredWorlds,
    progress: ReportProgress,
) -> PairedScan:
    """Pair two recordings that are appended to a store; poses are placed on its floors."""
    if options.align and stored.alignment is None:
        raise RequestError("--align: the worlds of the store are not aligned; leave it out")
    names = {checked_name(name, "trajectory") for name in real.trajectories}
    stored.check("sim", sim, names)
    stored.check("real", real, names)
    floors = stored.floors
    sides = (
        RecordedSide("sim", sim, put_on_stored_floor(sim, floors["sim"], "sim")),
        RecordedSide("real", real, put_on_stored_floor(real, floors["real"], "real")),
    )
    if stored.alignment is not None:
        sides[0].poses = stored.alignment.apply(sides[0].poses)
    pairing = pair_images(*sides, options.match, options.tolerance, progress)
    return _paired_scan(sides, pairing, options, stored.alignment, [])


def _paired_scan(
    sides: tuple[RecordedSide, RecordedSide],
    pairing: Pairing,
    options: PairOptions,
    alignment: FloorAlignment | None,
    worlds: list[InputIssue],
) -> PairedScan:
    """The scan of the pairs; `worlds` are issues of recordings without a common world."""
    unmatched = list(unmatched_images(*sides, pairing, options.match))
    if not pairing.sim.size:
        raise RequestError(_no_pairs(*sides, options, unmatched))
    scan = _empty_scan(*sides, pairing, options)
    for side in sides:
        scan.issues += [issue.of_side(side.side) for issue in side.recording.issues]
        for folder, count in side.recording.outside_folders.items():
            counts = dict(scan.outside_folders)
            scan.outside_folders = counts | {folder: counts.get(folder, 0) + count}
    scan.issues += worlds
    scan.issues += [issue.of_side(side.side) for side in sides for issue in side.floor.issues]
    scan.issues += pairing.issues
    scan.issues += [each.issue() for each in unmatched]
    scan.domains = {each.side: _domain(each, options.frame) for each in sides}
    _add_trajectories(scan, *sides, pairing)
    tolerance = options.match, options.tolerance
    scan.part_provenance = pair_facts.provenance(*sides, pairing, tolerance, alignment)
    is_stored = options.stored is not None
    if options.match != "pose":
        scan.issues += pair_facts.far_apart(sides[1], pairing, is_stored)
    summary = pair_facts.summary(*sides, pairing, options.match, alignment, is_stored)
    return PairedScan(scan, *sides, pairing, unmatched, summary)


def _several_worlds(sim: Recording, real: Recording) -> list[InputIssue]:
    """An issue for each recording whose trajectories lie in worlds of their own."""
    return [
        InputIssue(
            "several worlds",
            each.name,
            f"each of {len(each.trajectories)} trajectories has its own; their poses are not "
            "comparable with each other",
        ).of_side(side)
        for side, each in (("sim", sim), ("real", real))
        if not each.has_one_world
    ]


def _floors(sim: Recording, real: Recording, options: PairOptions) -> dict[Side, FloorPoses]:
    """The poses of both sides on the floor.

    Where neither the layout nor the options state the up axis of the sim world, it is that of the
    real one, unless the worlds differ: two fitted axes would not agree exactly.
    """
    own = options.floors
    floor = project_to_floor(real, own.get("real"))
    of_sim = own.get("sim", FloorOptions())
    if of_sim.up is None and sim.up is None and not options.align:
        of_sim = replace(of_sim, up=tuple(floor.up.tolist()))
    return {"sim": project_to_floor(sim, of_sim), "real": floor}


def _no_pairs(
    sim: RecordedSide, real: RecordedSide, options: PairOptions, unmatched: list[UnmatchedImage]
) -> str:
    start = f"{sim.recording.name}, {real.recording.name}: no pairs by --match {options.match}"
    timeless = [
        f"the {side.side} recording (layout {side.recording.layout}) has no times"
        for side in (sim, real)
        if not np.isfinite(side.times).any()
    ]
    if options.match == "time" and timeless:
        return f"{start}: {' and '.join(timeless)}; match by pose or name"
    near = [each for each in unmatched if math.isfinite(each.metres) or math.isfinite(each.seconds)]
    best = min(
        near,
        key=lambda each: each.seconds if math.isfinite(each.seconds) else each.metres,
        default=None,
    )
    found = f"; the nearest: {best.issue().file}, {best.issue().detail}" if best else ""
    return f"{start}{found}"


def _empty_scan(
    sim: RecordedSide, real: RecordedSide, pairing: Pairing, options: PairOptions
) -> Scan:
    """The data set without domains and trajectories; bounds are the file's or the poses'."""
    root = real.recording.root
    if options.calibration is not None:
        _refuse_camera(options.calibration)
        config = DatasetConfig(options.calibration, name=real.recording.name, y_down=False)
        containment = PathContainment(config.path.parent, options.allow_outside)
        if config.table.y_down:
            raise RequestError(
                f"{config.path}: y_down = true; on the floor of recordings y grows upwards"
            )
        return config.empty_scan(root, options.frame, containment)
    name, stored = real.recording.name, options.stored
    if stored is not None:
        bounds, scale = stored.bounds, stored.accuracy_scale
        return Scan(name, root, options.frame, False, bounds, scale, ())
    places = np.concatenate([sim.poses[pairing.sim, :2], real.poses[pairing.real, :2]])
    (x0, y0), (x1, y1) = places.min(axis=0) - MARGIN, places.max(axis=0) + MARGIN
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


def _domain(side: RecordedSide, frame: tuple[int, int]) -> Domain:
    """The domain of one side. Raises RequestError where depth cannot be put on the floor."""
    recording, floor = side.recording, side.floor
    has_depth = any(
        each.depth is not None
        for trajectory in recording.trajectories.values()
        for each in trajectory.frames
    )
    if has_depth and not math.isfinite(floor.camera_height):
        raise RequestError(
            f"{recording.layout}:{recording.name}: the height of the camera above the floor is not "
            f"known; give --{side.side}-floor camera_height=METRES"
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


def _add_trajectories(scan: Scan, sim: RecordedSide, real: RecordedSide, pairing: Pairing) -> None:
    """Add the pairs, by the trajectories of the real side, in its recording order."""

    def source(side: RecordedSide, number: int) -> RecordedFrameSource:
        recording, has_depth = side.recording, scan.domains[side.side].has_depth
        depth = recording.camera_of_depth if has_depth else None
        return RecordedFrameSource(side.frame(number), recording.camera, depth)

    def records(sims: Rows, reals: Rows) -> LazySequence[InstanceRecord]:
        def record(row: int) -> InstanceRecord:
            numbers = int(sims[row]), int(reals[row])
            sides = list(zip((sim, real), numbers, strict=True))
            x, y, heading = real.poses[numbers[1]].tolist()
            time = float(real.times[numbers[1]])
            return InstanceRecord(
                x, y, heading,
                {side.side: source(side, number) for side, number in sides},
                timestamp=time if math.isfinite(time) else None,
                frame_poses={side.side: _frame_pose(side, number) for side, number in sides},
            )  # fmt: skip

        return LazySequence(len(sims), record)

    codes = real.codes[pairing.real]
    for code, name in enumerate(real.names):
        chosen = np.flatnonzero(codes == code)
        if chosen.size:
            trajectory = checked_name(name, "trajectory")
            scan.add_trajectory(trajectory, records(pairing.sim[chosen], pairing.real[chosen]))


def _frame_pose(side: RecordedSide, number: int) -> FramePose:
    x, y, heading = side.poses[number].tolist()
    pose = side.camera_pose(number)
    position = (float(pose[0, 3]), float(pose[1, 3]), float(pose[2, 3]))
    a, b, c, d = (float(each) for each in Rotation.from_matrix(pose[:3, :3]).as_quat())
    return FramePose(x, y, heading, (*position, a, b, c, d))
