"""What an importer finds before any image is decoded."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Bounds, Domain, Room

FRAME = (256, 256)
MOST_PIXELS = 1 << 25
"""Pixels of a source image: a frame of 8K video; decoded, 100 MB of 8-bit RGB."""


@dataclass(frozen=True, slots=True)
class InputIssue:
    """One thing about the input that is not as it should be: its kind, the file, and why."""

    kind: str
    file: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class ScanOptions:
    """`header` is a calibration file (Sim2RealViz) or the manifest's header (CSV); `world` says
    what a generated data set is made from. `allow_outside` admits files outside of the data set's
    folder.
    """

    trajectories: tuple[str, ...] = ()
    header: Path | None = None
    frame: tuple[int, int] = FRAME
    world: Mapping[str, Any] = field(default_factory=dict)
    allow_outside: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class DecodedFrame:
    """rgb (H, W, 3) uint8 and depth (H, W) raw values at the stored size.

    `notes` tell what was changed; the view is kept all the same.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[Any]
    sha256: str
    valid_fraction: float
    notes: tuple[InputIssue, ...] = ()


@dataclass(frozen=True, slots=True)
class CheckedFrame:
    """A usable view: the type of its raw depth values, the notes on it, and where it was decoded
    for that, the view itself.
    """

    depth_type: str
    notes: tuple[InputIssue, ...] = ()
    view: DecodedFrame | None = None


class FrameSource(Protocol):
    """One view before it is read: image files, or a renderer's promise."""

    @property
    def pixels(self) -> int:
        """Pixels of its larger source image."""

    def files(self, scan: Scan) -> tuple[str | None, str | None]:
        """Names of the RGB and the depth file, relative to the scan's root."""

    def check(self, scan: Scan, domain: Domain) -> CheckedFrame | InputIssue:
        """Read the view and check everything about it."""

    def view(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        """The pixels; a Problem names the file that cannot be used."""


@dataclass(frozen=True, slots=True)
class InstanceRecord:
    """One instance as found: x, y in metres, headings in radians, timestamp in seconds."""

    x: float
    y: float
    heading: float
    images: Mapping[str, FrameSource]
    odometry: tuple[float, float, float] | None = None
    timestamp: float | None = None


@dataclass(frozen=True, slots=True)
class FrameChecksum:
    """What is kept of a view once its pixels are written; the hash is of both files' bytes."""

    sha256: str
    valid_fraction: float


@dataclass(slots=True)
class Scan:
    """A data set as an importer found it; `domains` hold for the stored frame size.

    `trajectories` maps names to sightings in recording order; `root` is what file names in
    reports are relative to. `floor_plan` is a file or a picture (h, w, 3) uint8 RGB that fills the
    bounds; `notes` go into the store's provenance under the importer's name. `drives` writes the
    robot's drives into a folder that it makes. `outside` counts the files that are read outside of
    the data set's folder, by their folder.
    """

    name: str
    root: Path
    frame: tuple[int, int]
    y_down: bool
    bounds: Bounds
    accuracy_scale: float
    domains: dict[str, Domain]
    rooms: tuple[Room, ...]
    floor_plan: Path | NDArray[np.uint8] | None
    trajectories: dict[str, list[InstanceRecord]]
    recorded_at: dict[str, str] = field(default_factory=dict)
    problems: list[InputIssue] = field(default_factory=list)
    notes: dict[str, dict[str, Any]] = field(default_factory=dict)
    drives: Callable[[Path], object] | None = None
    outside: Mapping[str, int] = field(default_factory=dict)

    def relative(self, path: Path) -> str:
        try:
            return path.relative_to(self.root).as_posix()
        except ValueError:
            return path.as_posix()
