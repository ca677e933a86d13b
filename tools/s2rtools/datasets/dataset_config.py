"""Data set configuration: bounds, rooms and cameras of a data set, as TOML or JSON.

    name = "office"             y_down = true          accuracy_scale = 26.0   (optional, m)
    recall_thresholds = [[0.25, 2], [0.5, 5], [1, 10], [2, 20]]   metres and degrees (optional)
    floor_plan = "map.png"      image that fills the bounds, a ROS map.yaml, or a table
                                { image, points }: see `floor_plans` (optional)
    [bounds]                    x0, y0, x1, y1 in metres; by default those of a placed floor plan
    [recorded_at]               TRAJECTORY = "2026-03-02T10:00"  (optional)
    [[rooms]]                   room = "hall", rectangles = [[x0, y0, x1, y1], ...]  (optional)
    [domains.NAME]              kind = "sim" | "real", width, height of the original images,
                                rgb = { hfov | fx, fy, cx, cy; pitch }, depth = { ... },
                                camera_height, forward_offset, depth_scale, depth_raw_min,
                                depth_raw_max, source = { ... }  (optional)

`source` in [bounds] and in a domain says where the figures come from. Unknown keys are refused.

Angles in degrees, intrinsics in pixels of the original images with pixel i covering [i, i + 1).
If depth images have another size than RGB images, set `width` and `height` in `rgb` and `depth`.
Errors name the file, the key and the allowed values.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Struct, field

from s2rstore.errors import RequestError, shortened
from s2rstore.files.documents import read_document
from s2rstore.files.layout import checked_name
from s2rstore.index.row_records import THRESHOLDS_ARE, are_thresholds
from s2rstore.records import Bounds, Domain, Intrinsics, Room
from s2rtools.common.image_files import MAX_PIXELS
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.typed_documents import convert
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.floor.floor_plans import PlacedPlan, PointsTable, placed_plan
from s2rtools.datasets.recording import PinholeCamera
from s2rtools.datasets.scan import Scan

Coordinate = Annotated[float, Meta(ge=-1e6, le=1e6)]
Positive = Annotated[float, Meta(gt=0, le=1e6)]
Degrees = Annotated[float, Meta(ge=1, le=179)]
Size = tuple[int, int]

_MIN_EXTENT = 0.01
_RAW_MAX = 65535


class BoundsTable(Struct, forbid_unknown_fields=True):
    """Edges of the map, metres; `source` says where they come from, and is not stored."""

    x0: Coordinate
    y0: Coordinate
    x1: Coordinate
    y1: Coordinate
    source: str = ""

    def __post_init__(self) -> None:
        if self.x1 - self.x0 < _MIN_EXTENT or self.y1 - self.y0 < _MIN_EXTENT:
            raise ValueError("x1 and y1 must be larger than x0 and y0, by 1 cm")


class RoomTable(Struct, forbid_unknown_fields=True):
    """A room and the rectangles (x0, y0, x1, y1) that it consists of, metres."""

    room: str
    rectangles: list[tuple[Coordinate, Coordinate, Coordinate, Coordinate]] = []

    def __post_init__(self) -> None:
        if not self.room or not self.room.isprintable():
            raise ValueError("room must be a name in printable letters")
        if any(x1 <= x0 or y1 <= y0 for x0, y0, x1, y1 in self.rectangles):
            raise ValueError(f"room {self.room!r}: x1, y1 must be larger than x0, y0")


class CameraTable(Struct, kw_only=True, forbid_unknown_fields=True):
    """A camera with one field of view, or with intrinsics; pitch in degrees."""

    width: Positive
    height: Positive
    pitch: Coordinate = 0.0

    def __post_init__(self) -> None:
        if not (self.width.is_integer() and self.height.is_integer()):
            raise ValueError("width and height are whole numbers of pixels")
        if self.width * self.height > MAX_PIXELS:
            size = f"{self.width:.0f}x{self.height:.0f}"
            raise ValueError(f"{size} pixels; at most {MAX_PIXELS:,} are read")

    @property
    def size(self) -> Size:
        """(height, width)."""
        return int(self.height), int(self.width)

    def intrinsics(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy in pixels of the original image."""
        raise NotImplementedError

    def pinhole(
        self, distortion: tuple[float, ...] = (), is_fisheye: bool = False
    ) -> PinholeCamera:
        """The camera of the original images."""
        height, width = self.size
        return PinholeCamera(width, height, *self.intrinsics(), distortion, is_fisheye)


class FieldOfViewCamera(CameraTable, kw_only=True, forbid_unknown_fields=True):
    hfov: Degrees

    def intrinsics(self) -> tuple[float, float, float, float]:
        focal = self.width / 2 / math.tan(math.radians(self.hfov) / 2)
        return focal, focal, self.width / 2, self.height / 2


class IntrinsicsCamera(CameraTable, kw_only=True, forbid_unknown_fields=True):
    fx: Positive
    fy: Positive
    cx: Coordinate
    cy: Coordinate

    def intrinsics(self) -> tuple[float, float, float, float]:
        return self.fx, self.fy, self.cx, self.cy


class DomainTable(Struct, forbid_unknown_fields=True):
    """A domain; its cameras are converted from `width`, `height`, `rgb` and `depth`."""

    kind: str
    camera_height: Coordinate
    depth_scale: Positive
    forward_offset: Coordinate = 0.0
    depth_raw_min: Coordinate = 1
    depth_raw_max: Coordinate = _RAW_MAX - 1
    source: dict[str, str] = {}
    width: Any = None
    height: Any = None
    rgb: Any = None
    depth: Any = None

    def __post_init__(self) -> None:
        if self.kind not in ("sim", "real"):
            raise ValueError('kind = "sim" or "real"')
        if not 0 <= self.depth_raw_min <= self.depth_raw_max <= _RAW_MAX:
            raise ValueError(f"0 <= depth_raw_min <= depth_raw_max <= {_RAW_MAX}")


class DatasetTable(Struct, forbid_unknown_fields=True):
    """The keys of the file; `domains` are converted when they are needed."""

    name: str
    y_down: bool
    bounds: BoundsTable | msgspec.UnsetType = msgspec.UNSET
    floor_plan: str | PointsTable = ""
    accuracy_scale: Positive | msgspec.UnsetType = msgspec.UNSET
    recall_thresholds: list[tuple[float, float]] | None = None
    recorded_at: dict[str, Any] = field(default_factory=dict)
    rooms: list[RoomTable] = []
    domains: dict[str, dict[str, Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key, text in (("name", self.name), ("floor_plan", self.floor_plan)):
            if isinstance(text, str) and not text.isprintable():
                raise ValueError(f"{key} must be printable text")
        if self.recall_thresholds is not None and not are_thresholds(self.recall_thresholds):
            raise ValueError(f"recall_thresholds: {THRESHOLDS_ARE}")


class DatasetConfig:
    """The validated configuration of one data set."""

    def __init__(self, path: Path, **defaults: Any) -> None:
        """Read a file; `defaults` are values of keys that it does not have.

        Raises RequestError naming the file and the key.
        """
        document = read_document(path)
        if isinstance(document, dict):
            document = {**defaults, **document}
        self.path = path
        self.table = convert(document, DatasetTable, str(path), check=False)

    def empty_scan(self, root: Path, frame: Size, containment: PathContainment) -> Scan:
        """A scan of the data set in `root`, without domains and trajectories.

        Rooms are in order of precedence; the accuracy scale is the diagonal of the bounds by
        default. Raises RequestError if the floor plan cannot be used, or if there are no bounds.
        """
        table = self.table
        plan = self._placed_plan(containment)
        bounds = self._bounds(plan)
        scale = table.accuracy_scale
        rectangles = [(r.room, edges) for r in table.rooms for edges in r.rectangles]
        result = Scan(
            name=table.name,
            root=root,
            frame=frame,
            y_down=table.y_down,
            bounds=bounds,
            accuracy_scale=bounds.diagonal if isinstance(scale, msgspec.UnsetType) else scale,
            rooms=tuple(Room(name, n, *edges) for n, (name, edges) in enumerate(rectangles)),
            outside_folders=containment.outside_folders,
            has_default_scale=isinstance(scale, msgspec.UnsetType),
            recall_thresholds=tuple(table.recall_thresholds) if table.recall_thresholds else None,
        )
        if plan is not None:
            result.floor_plan = plan.resampled(bounds, table.y_down)
        elif isinstance(table.floor_plan, str) and table.floor_plan:
            file = self._resolve(containment)(table.floor_plan)
            if file.is_file():
                result.floor_plan = file
            else:
                result.issues.append(InputIssue("missing floor plan", table.floor_plan))
        return result

    def _resolve(self, containment: PathContainment) -> Callable[[str], Path]:
        """Resolves the names of files of the floor plan, in the configuration's folder."""
        folder = containment.for_folder(self.path.parent)
        return lambda name: folder.resolve(name, f"{self.path}: floor_plan")

    def _placed_plan(self, containment: PathContainment) -> PlacedPlan | None:
        table = self.table
        resolve = self._resolve(containment)
        return placed_plan(table.floor_plan, str(self.path), resolve, table.y_down)

    def _bounds(self, plan: PlacedPlan | None) -> Bounds:
        edges = self.table.bounds
        if not isinstance(edges, msgspec.UnsetType):
            return Bounds(edges.x0, edges.y0, edges.x1, edges.y1)
        if plan is None:
            raise RequestError(f"{self.path}: bounds: missing")
        return plan.bounds

    def domain(self, name: str, frame: Size) -> Domain:
        """A domain with its cameras scaled to frames of (height, width)."""
        table = convert(
            self._domain_table(name), DomainTable, str(self.path), False, f"domains.{name}"
        )
        return Domain(
            domain=checked_name(name, "domain"),
            kind="sim" if table.kind == "sim" else "real",
            rgb=self._intrinsics(name, "rgb", frame),
            depth=self._intrinsics(name, "depth", frame),
            camera_height=table.camera_height,
            forward_offset=table.forward_offset,
            depth_scale=table.depth_scale,
            depth_raw_min=int(table.depth_raw_min),
            depth_raw_max=int(table.depth_raw_max),
            sources=table.source,
        )

    def image_sizes(self, name: str) -> tuple[Size, Size]:
        """(height, width) of a domain's original RGB and depth images."""
        return self._camera(name, "rgb").size, self._camera(name, "depth").size

    def _domain_table(self, name: str) -> dict[str, Any]:
        if name not in self.table.domains:
            known = ", ".join(self.table.domains) or "none"
            raise RequestError(
                f"{self.path}: no [domains.{shortened(name)}] (has: {shortened(known)})"
            )
        return self.table.domains[name]

    def _intrinsics(self, name: str, image: str, frame: Size) -> Intrinsics:
        camera = self._camera(name, image)
        return camera.pinhole().intrinsics(frame, math.radians(camera.pitch))

    def _camera(self, name: str, image: str) -> CameraTable:
        domain = self._domain_table(name)
        table = domain.get(image, {})
        kind: type[CameraTable] = IntrinsicsCamera
        if isinstance(table, dict):
            kind = FieldOfViewCamera if "hfov" in table else kind
            table = {key: domain[key] for key in ("width", "height") if key in domain} | table
        return convert(table, kind, str(self.path), False, f"domains.{name}.{image}")
