"""Records that an importer returns before any image is decoded, and those that are stored."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays.zarr_metadata import ITEM_BYTES
from s2rstore.errors import RequestError
from s2rstore.files.layout import checked_name
from s2rstore.geometry import angles
from s2rstore.records import Bounds, Domain, RecallThresholds, Room, Side
from s2rtools.common.input_issue import InputIssue

FRAME_SIZE = (256, 256)
_DIGEST = 32
"""Bytes of a SHA-256."""


@dataclass(frozen=True, slots=True)
class ScanOptions:
    """Options of an importer.

    `header` is the data set configuration (CSV) or the calibration file (Sim2RealViz). `world`
    holds the fields of a `WorldRecipe`. `allow_outside` admits files outside the data set's folder.
    `folders` are those of images without poses, by domain; the longer edge of `frame` is that of
    their frames.
    """

    trajectories: tuple[str, ...] = ()
    header: Path | None = None
    frame: tuple[int, int] = FRAME_SIZE
    world: Mapping[str, Any] = field(default_factory=dict)
    allow_outside: bool = False
    folders: Mapping[Side, Path] = field(default_factory=dict)

    def choose_trajectories(self, known: Iterable[str], where: object) -> list[str]:
        """See `choose_trajectories`; messages name the argument `--trajectory`."""
        return choose_trajectories(self.trajectories, known, where, "--trajectory")


@dataclass(frozen=True, slots=True, eq=False)
class SourceImages:
    """rgb (H, W, 3) uint8 and raw depth (H', W') as the files hold them; None without depth."""

    rgb: NDArray[np.uint8]
    depth: NDArray[Any] | None

    @property
    def is_storable(self) -> bool:
        """Whether an array can hold such images."""
        depth = 0 if self.depth is None else self.depth.nbytes
        return max(self.rgb.nbytes, depth) <= ITEM_BYTES


@dataclass(frozen=True, slots=True, eq=False)
class DecodedFrame:
    """rgb (H, W, 3) uint8 and depth (H, W) raw values at the frame size; None without depth.

    `source` holds both images at the sizes of their source, from which the input of networks is
    made; None where these are the frame size, and in a data set without poses. `issues` report
    conversions that lost information; the frame is stored nevertheless.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[Any] | None
    sha256: str
    valid_fraction: float
    issues: tuple[InputIssue, ...] = ()
    source: SourceImages | None = None


class FrameSource(Protocol):
    """Source of one frame: a pair of image files, a cached frame, or a renderer."""

    @property
    def pixels(self) -> int:
        """Pixels of the larger source image."""

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        """Names of the RGB and the depth file relative to the scan's root; None without files."""

    def checksum(self, scan: Scan, domain: Domain) -> str | None:
        """`DecodedFrame.sha256` without decoding; None where the source cannot be read."""

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        """The pixels, or an InputIssue that names the unusable file."""


@dataclass(frozen=True, slots=True)
class FramePose:
    """The pose of one frame: x, y in metres and heading in radians on the map.

    `camera` is that of the camera in the recording's world: its position x, y, z in metres and the
    unit quaternion x, y, z, w from the camera's axes (x right, y down, z forward) to the world.
    """

    x: float
    y: float
    heading: float
    camera: tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class InstanceRecord:
    """One instance: x, y in metres, headings in radians, timestamp in seconds, frames by domain.

    In a data set without poses x, y and heading are NaN. An instance may lack the frames of some
    domains, the same ones as the others of its trajectory. `frame_poses` are given by domain where
    the images of an instance come from recordings; without them every frame has the pose of the
    instance.
    `seq` is the number that the source gives the instance within its trajectory, ascending; None
    where the source gives none.
    """

    x: float
    y: float
    heading: float
    sources: Mapping[str, FrameSource]
    odometry: tuple[float, float, float] | None = None
    timestamp: float | None = None
    frame_poses: Mapping[str, FramePose] = field(default_factory=dict)
    seq: int | None = None

    @property
    def pair_offset(self) -> tuple[float, float]:
        """Largest distance, metres, and angle, degrees, of a frame's pose from the instance's."""
        metres = [math.hypot(p.x - self.x, p.y - self.y) for p in self.frame_poses.values()]
        turns = [angles.distance(p.heading, self.heading) for p in self.frame_poses.values()]
        return max(metres, default=0.0), math.degrees(max(turns, default=0.0))


@dataclass(frozen=True, slots=True)
class FrameChecksum:
    """SHA-256 of the source files of a stored frame, and its share of valid depth, NaN for none."""

    sha256: str
    valid_fraction: float


@dataclass(slots=True)
class Scan:
    """A data set as an importer read it; `domains` hold cameras for the stored frame size.

    `trajectories` maps names to instances in recording order. File names in reports are relative
    to `root`. `floor_plan` is a file or an image (h, w, 3) uint8 RGB that fills the bounds.
    `provenance` is stored by section; a scan can be appended to stores of the same provenance
    only. `part_provenance` are facts that each append records anew. `drives` writes the robot's
    drives into a new folder.
    `outside_folders` counts the files that were read outside the data set's folder, by folder.
    With `has_default_scale`, `accuracy_scale` is not stated, and that of a store counts.
    `recall_thresholds` are None where they are not stated.
    Without poses (`has_poses` false) there are no depth, no cameras, no bounds and no floor plan.
    """

    name: str
    root: Path
    frame: tuple[int, int]
    y_down: bool
    bounds: Bounds
    accuracy_scale: float
    rooms: tuple[Room, ...]
    domains: dict[str, Domain] = field(default_factory=dict)
    floor_plan: Path | NDArray[np.uint8] | None = None
    trajectories: dict[str, Sequence[InstanceRecord]] = field(default_factory=dict)
    recorded_at: dict[str, str] = field(default_factory=dict)
    issues: list[InputIssue] = field(default_factory=list)
    provenance: dict[str, dict[str, Any]] = field(default_factory=dict)
    part_provenance: dict[str, dict[str, Any]] = field(default_factory=dict)
    drives: Callable[[Path], object] | None = None
    outside_folders: Mapping[str, int] = field(default_factory=dict)
    has_poses: bool = True
    has_default_scale: bool = False
    recall_thresholds: RecallThresholds | None = None

    @property
    def unit(self) -> str:
        """What an instance consists of, as reports call it."""
        kinds = {domain.kind for domain in self.domains.values()}
        return "pair" if self.has_poses and len(kinds) > 1 else "image"

    def add_trajectory(self, name: str, records: Sequence[InstanceRecord]) -> None:
        """Add the usable records of a trajectory; without any, add an issue."""
        if records:
            self.trajectories[name] = records
        else:
            self.issues.append(InputIssue("empty trajectory", name, f"no usable {self.unit}"))

    def relative(self, path: Path) -> str:
        """The path relative to `root`, or unchanged if it lies elsewhere."""
        try:
            return path.relative_to(self.root).as_posix()
        except ValueError:
            return path.as_posix()


def choose_trajectories(
    requested: Sequence[str], known: Iterable[str], where: object, argument: str = "trajectory"
) -> list[str]:
    """The requested trajectories, all of `known` by default.

    Raises RequestError, naming the `argument`, for unknown names, and for names that a trajectory
    cannot have.
    """
    names = list(known)
    for name in requested:
        if name not in names:
            raise RequestError(f"{argument} {name}: not in {where} (has: {', '.join(names)})")
    return [checked_name(name, "trajectory") for name in requested or names]


class StoredTrajectory:
    """The stored ones of a trajectory's records, in recording order.

    An instance takes 4 bytes of memory, and 40 for each of its domains.
    """

    def __init__(self, records: Sequence[InstanceRecord]) -> None:
        self._records = records
        self._rows = array("i")
        self._digests: dict[str, bytearray] = {}
        self._valid_fractions: dict[str, array[float]] = {}

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[tuple[InstanceRecord, dict[str, FrameChecksum]]]:
        """The records and the checksums of their frames, by domain."""
        for position, row in enumerate(self._rows):
            checksums = {domain: self.checksum(domain, position) for domain in self._digests}
            yield self._records[row], checksums

    def records(self, start: int = 0, stop: int | None = None) -> list[InstanceRecord]:
        """The stored records of some positions."""
        return [self._records[row] for row in self._rows[start:stop]]

    @property
    def domains(self) -> list[str]:
        """The domains of the frames."""
        return list(self._digests)

    def row_numbers(self, start: int = 0) -> list[int]:
        """The numbers of the stored records from a position on."""
        return self._rows[start:].tolist()

    def headings(self) -> NDArray[np.float64]:
        """The headings of all instances, radians."""
        headings = (self._records[row].heading for row in self._rows)
        return np.fromiter(headings, np.float64, len(self))

    def checksum(self, domain: str, position: int) -> FrameChecksum:
        """The checksum of the frame of a domain at a position."""
        digest = self._digests[domain][_DIGEST * position : _DIGEST * (position + 1)]
        return FrameChecksum(digest.hex(), self._valid_fractions[domain][position])

    def add(self, row: int, checksums: Mapping[str, FrameChecksum]) -> None:
        """Add the record number `row` with the checksums of its frames by domain."""
        self._rows.append(row)
        for domain, frame in checksums.items():
            self._digests.setdefault(domain, bytearray()).extend(bytes.fromhex(frame.sha256))
            self._valid_fractions.setdefault(domain, array("d")).append(frame.valid_fraction)


StoredRecords = dict[str, StoredTrajectory]
