"""A data set of pairs from two recordings, one of the sim and one of the real side."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.files.layout import checked_name
from s2rstore.records import Side
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.floor.floor_alignment import FloorAlignment, fit_alignment
from s2rtools.datasets.floor.floor_poses import (
    FittedScale,
    FloorOptions,
    FloorPoses,
    project_to_floor,
    put_on_stored_floor,
)
from s2rtools.datasets.pairing import pair_facts
from s2rtools.datasets.pairing.pair_matching import (
    PoseTolerance,
    ReportProgress,
)
from s2rtools.datasets.pairing.recorded_scan import MapOptions, scan_of_sides
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
from s2rtools.datasets.scan import Scan


@dataclass(frozen=True, slots=True)
class PairOptions:
    """How two recordings become a data set.

    `tolerance` is that of `recording_pairs.parse_tolerance`. With `align`, the floor of the sim
    recording is fitted to that of the real one by the pairs, which then are those of times or
    names. `floors` say how poses are put on the floor. Where the pairs are appended to a store,
    `floors` are not used, and `align` needs an alignment in the store.
    """

    match: Match
    tolerance: PoseTolerance | float | None
    map: MapOptions
    align: bool = False
    floors: Mapping[Side, FloorOptions] = field(default_factory=dict)


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
    if options.map.stored is not None:
        return _scan_further_pairs(sim, real, options, options.map.stored, progress)
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
    scan = scan_of_sides(sides, (pairing.sim, pairing.real), options.map)
    scan.issues += [*worlds, *pairing.issues, *(each.issue() for each in unmatched)]
    tolerance = options.match, options.tolerance
    scan.part_provenance = pair_facts.provenance(*sides, pairing, tolerance, alignment)
    is_stored = options.map.stored is not None
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
