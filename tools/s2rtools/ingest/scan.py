"""What an importer finds before any image is decoded."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from s2rstore.records import Bounds, Domain, Room

FRAME = (256, 256)


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing about the input that is not as it should be: its kind, the file, and why."""

    kind: str
    file: str
    detail: str = ""


@dataclass(frozen=True, slots=True)
class ScanOptions:
    """`header` is a calibration file (Sim2RealViz) or the manifest's header (CSV)."""

    trajectories: tuple[str, ...] = ()
    header: Path | None = None
    frame: tuple[int, int] = FRAME


@dataclass(frozen=True, slots=True)
class Images:
    """The two source files of one view, and the (height, width) that each must have."""

    rgb: Path
    depth: Path
    rgb_size: tuple[int, int]
    depth_size: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Sighting:
    """One instance as found: x, y in metres, headings in radians, timestamp in seconds."""

    x: float
    y: float
    heading: float
    images: dict[str, Images]
    odometry: tuple[float, float, float] | None = None
    timestamp: float | None = None


@dataclass(frozen=True, slots=True)
class Facts:
    """What is kept of a view once its pixels are written; the hash is of both files' bytes."""

    sha256: str
    valid_fraction: float


@dataclass(slots=True)
class Scan:
    """A data set as an importer found it; `domains` hold for the stored frame size.

    `trajectories` maps names to sightings in recording order; `root` is what file names in
    reports are relative to.
    """

    name: str
    root: Path
    frame: tuple[int, int]
    y_down: bool
    bounds: Bounds
    accuracy_scale: float
    domains: dict[str, Domain]
    rooms: tuple[Room, ...]
    floor_plan: Path | None
    trajectories: dict[str, list[Sighting]]
    recorded_at: dict[str, str] = field(default_factory=dict)
    problems: list[Problem] = field(default_factory=list)

    def relative(self, path: Path) -> str:
        try:
            return path.relative_to(self.root).as_posix()
        except ValueError:
            return path.as_posix()
