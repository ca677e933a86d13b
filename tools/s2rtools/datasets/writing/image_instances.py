"""Data sets of images without poses: from image sources, or from images that a program makes.

Such a data set has no map, no depth and no cameras. An instance is one moment of a recording. It
has a frame in every domain that images its trajectory: in one domain for a folder of pictures, in
two for the images of a camera and their translations.
"""

from __future__ import annotations

import hashlib
import math
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.layout import checked_name
from s2rstore.index.row_records import MAX_ROWS
from s2rstore.lazy_sequence import LazySequence, RowFile
from s2rstore.records import SIDES, Bounds, Domain, Intrinsics, Side
from s2rtools.common.frame_resizing import resized_rgb
from s2rtools.datasets.scan import DecodedFrame, FrameSource, InstanceRecord, Scan
from s2rtools.datasets.writing.build import build

LONG_EDGE = 320
"""Default of the longer edge of stored frames, pixels."""
MIN_EDGE = 16
_NO_CAMERA = Intrinsics(*[math.nan] * 5)


@dataclass(frozen=True, slots=True, eq=False)
class ImageInstance:
    """Images (h, w, 3) uint8 RGB of one moment by domain; `timestamp` in seconds.

    All instances of a trajectory have the same domains. `name` is stored as the source of the
    images, such as a topic and its sequence number.
    """

    trajectory: str
    images: Mapping[str, NDArray[np.uint8]]
    timestamp: float | None = None
    name: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _CachedFrame:
    """A `FrameSource` whose frame without depth is row `number` of a temporary file."""

    images: RowFile
    number: int
    name: str | None
    pixels: int
    sha256: str

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        return self.name, None

    def checksum(self, scan: Scan, domain: Domain) -> str:
        return self.sha256

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame:
        shape, rgb = self.images[self.number]
        pixels = np.frombuffer(rgb, np.uint8).reshape(shape)
        return DecodedFrame(pixels, None, self.sha256, math.nan)


def empty_scan(name: str, root: Path, frame: tuple[int, int], domains: Mapping[str, Side]) -> Scan:
    """A data set without poses whose frames have (height, width), before it has trajectories.

    Raises RequestError for names of domains that cannot name a folder.
    """
    edges = Bounds(*[math.nan] * 4)
    scan = Scan(name, root, frame, False, edges, math.nan, (), has_poses=False)
    scan.domains = {
        checked_name(domain, "domain"): _domain(domain, kind) for domain, kind in domains.items()
    }
    return scan


def _domain(name: str, kind: Side) -> Domain:
    if kind not in SIDES:
        raise RequestError(f"domain {name}: its kind must be sim or real, not {kind!r}")
    nothing = math.nan, math.nan, math.nan
    return Domain(
        name, kind, _NO_CAMERA, _NO_CAMERA, *nothing,
        depth_raw_min=1, depth_raw_max=0, has_depth=False,
    )  # fmt: skip


def add_images(
    scan: Scan,
    trajectory: str,
    sources: Sequence[Mapping[str, FrameSource]],
    timestamps: Sequence[float | None] | None = None,
) -> None:
    """Add a trajectory of images, in recording order: the sources of each instance by domain.

    Raises RequestError where the instances have different domains or an unknown one, and for names
    that cannot name a folder.
    """
    checked_name(trajectory, "trajectory")
    if len(scan.trajectories) >= MAX_ROWS["trajectory"]:
        raise RequestError(f"{scan.name}: more than {MAX_ROWS['trajectory']:,} trajectories")
    domains = set(sources[0]) if sources else set()
    if not domains <= set(scan.domains) or any(not row or set(row) != domains for row in sources):
        raise RequestError(
            f"trajectory {trajectory}: all instances need images of the same domains "
            f"(of {', '.join(scan.domains)})"
        )

    def record(row: int) -> InstanceRecord:
        timestamp = None if timestamps is None else timestamps[row]
        return InstanceRecord(math.nan, math.nan, math.nan, sources[row], timestamp=timestamp)

    scan.add_trajectory(trajectory, LazySequence(len(sources), record))


def frame_size(size: tuple[int, int], long_edge: int = LONG_EDGE) -> tuple[int, int]:
    """(height, width) of frames for images of a size: never larger, of the same aspect ratio."""
    scale = min(1.0, long_edge / max(size))
    height, width = (max(MIN_EDGE, round(edge * scale)) for edge in size)
    return height, width


def build_from_images(
    instances: Iterable[ImageInstance],
    domains: Mapping[str, Side],
    target: Path,
    name: str,
    command: str,
    long_edge: int = LONG_EDGE,
) -> Scan:
    """Make a store of images that are produced one after another, each used once.

    `domains` gives the kind of each domain. The first image decides on the shape of the frames; the
    others are resized to it. One frame at a time is in memory, the others in temporary files.
    Raises RequestError as `build` does, and where `instances` is empty.
    """
    if target.exists():
        raise RequestError(f"{target}: exists; choose another --store, or remove it")
    trajectories: dict[str, array[int]] = {}
    stored, images = RowFile(), RowFile()
    scan: Scan | None = None
    for instance in instances:
        if scan is None:
            first = next(iter(instance.images.values()))
            size = frame_size((first.shape[0], first.shape[1]), long_edge)
            scan = empty_scan(name, target.parent, size, domains)
        frames: dict[str, tuple[int, str | None, int, str]] = {}
        for domain, rgb in instance.images.items():
            small, sha256 = _stored(rgb, scan.frame)
            image = images.append(small.shape, small.tobytes())
            frames[domain] = image, instance.name, rgb.shape[0] * rgb.shape[1], sha256
        number = stored.append(instance.timestamp, frames)
        trajectories.setdefault(instance.trajectory, array("i")).append(number)
    if scan is None:
        raise RequestError(f"{name}: no images; nothing was ingested")
    for trajectory, numbers in trajectories.items():
        add_images(scan, trajectory, *_cached_instances(numbers, stored, images))
    build(scan, target, command, False, lambda steps: None)
    return scan


def _cached_instances(
    numbers: array[int], stored: RowFile, images: RowFile
) -> tuple[Sequence[Mapping[str, FrameSource]], Sequence[float | None]]:
    """The sources by domain and the times of some instances, read from temporary files."""

    def sources(row: int) -> Mapping[str, FrameSource]:
        _, frames = stored[numbers[row]]
        return {domain: _CachedFrame(images, *facts) for domain, facts in frames.items()}

    def timestamp(row: int) -> float | None:
        return stored[numbers[row]][0]

    count = len(numbers)
    return LazySequence(count, sources), LazySequence(count, timestamp)


def _stored(rgb: NDArray[np.uint8], frame: tuple[int, int]) -> tuple[NDArray[np.uint8], str]:
    """The frame of an image, and the SHA-256 of the pixels as they were given."""
    if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3 or not rgb.size:
        raise RequestError(f"an image of {rgb.dtype} {rgb.shape}: must be uint8 (h, w, 3)")
    return resized_rgb(rgb, frame), hashlib.sha256(np.ascontiguousarray(rgb).data).hexdigest()
