"""The data file beside the images: bounds, rooms and cameras, as TOML or JSON.

    name = "office"             y_down = true          accuracy_scale = 26.0   (optional, m)
    floor_plan = "map.png"      picture that fills the bounds (optional)
    [bounds]                    x0, y0, x1, y1 in metres
    [[rooms]]                   room = "hall", rectangles = [[x0, y0, x1, y1], ...]  (optional)
    [domains.NAME]              kind = "sim" | "real", width, height of the original images,
                                rgb = { hfov | fx, fy, cx, cy; pitch }, depth = { ... },
                                camera_height, forward_offset, depth_scale, depth_raw_min,
                                depth_raw_max, source = { ... }  (optional)

Angles in degrees, intrinsics in pixels of the original images with pixel i covering [i, i + 1).
Where depth images have another size than RGB images, `rgb` and `depth` carry their own width and
height.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.files.input_files import read_document
from s2rstore.files.layout import checked_name
from s2rstore.records import Bounds, Domain, Intrinsics, Room
from s2rtools.datasets.scan import MOST_PIXELS

Table = dict[str, Any]

_EDGES = ("x0", "y0", "x1", "y1")
_RAW_MAX = 65535
_LIMIT = 1e6


def read(path: Path) -> Table:
    """Raises RequestError naming the file where it cannot be read."""
    return _table(read_document(path), path, "the file")


def bounds(data: Table, path: Path) -> Bounds:
    table = _table(data.get("bounds", {}), path, "bounds")
    edges = [_number(table, name, path, "bounds") for name in _EDGES]
    if edges[2] - edges[0] < 0.01 or edges[3] - edges[1] < 0.01:
        raise RequestError(f"{path}: bounds: x1 and y1 must be larger than x0 and y0, by 1 cm")
    return Bounds(*edges)


def text(data: Table, key: str, default: str, path: Path) -> str:
    value = data.get(key, default)
    if not isinstance(value, str) or not value.isprintable():
        raise RequestError(f"{path}: {key} must be printable text")
    return value


def flag(data: Table, key: str, default: bool, path: Path) -> bool:
    value = data.get(key, default)
    if not isinstance(value, bool):
        raise RequestError(f"{path}: {key} must be true or false")
    return value


def scale(data: Table, default: float, path: Path) -> float:
    """The data set's `accuracy_scale`, metres."""
    return _positive({"accuracy_scale": default, **data}, "accuracy_scale", path, "data set")


def recorded_at(data: Table, path: Path) -> dict[str, str]:
    """When each trajectory was recorded, as written."""
    table = _table(data.get("recorded_at", {}), path, "recorded_at")
    return {str(name): str(value) for name, value in table.items()}


def rooms(data: Table, path: Path) -> tuple[Room, ...]:
    """Rectangles in order of precedence."""
    made: list[Room] = []
    entries = data.get("rooms", [])
    if not isinstance(entries, list):
        raise RequestError(f"{path}: rooms must be a list, written as [[rooms]]")
    for entry in entries:
        name = _table(entry, path, "rooms").get("room")
        if not isinstance(name, str) or not name or not name.isprintable():
            raise RequestError(f"{path}: rooms: each needs room = its name, in printable letters")
        rectangles = entry.get("rectangles", [])
        for rectangle in rectangles if isinstance(rectangles, list) else [rectangles]:
            corners = dict(zip(_EDGES, rectangle, strict=False)) if _is_four(rectangle) else {}
            if not corners:
                raise RequestError(f"{path}: room {name!r}: rectangles are 4 numbers")
            edges = [_number(corners, key, path, f"room {name!r}") for key in _EDGES]
            if edges[2] <= edges[0] or edges[3] <= edges[1]:
                raise RequestError(f"{path}: room {name!r}: x1, y1 must be larger than x0, y0")
            made.append(Room(name, len(made), *edges))
    return tuple(made)


def domain(data: Table, name: str, frame: tuple[int, int], path: Path) -> Domain:
    """The cameras of one domain, scaled to frames of (height, width)."""
    found = _domain(data, name, path)
    where = f"domains.{name}"
    if found.get("kind") not in ("sim", "real"):
        raise RequestError(f'{path}: {where}: kind = "sim" or "real"')
    low = _number({"depth_raw_min": 1, **found}, "depth_raw_min", path, where)
    high = _number({"depth_raw_max": _RAW_MAX - 1, **found}, "depth_raw_max", path, where)
    if not 0 <= low <= high <= _RAW_MAX:
        raise RequestError(f"{path}: {where}: 0 <= depth_raw_min <= depth_raw_max <= {_RAW_MAX}")
    return Domain(
        domain=checked_name(name, "domain"),
        kind=found["kind"],
        rgb=_camera(found, "rgb", frame, path, where),
        depth=_camera(found, "depth", frame, path, where),
        camera_height=_number(found, "camera_height", path, where),
        forward_offset=_number({"forward_offset": 0.0, **found}, "forward_offset", path, where),
        depth_scale=_positive(found, "depth_scale", path, where),
        depth_raw_min=int(low),
        depth_raw_max=int(high),
        sources=_sources(found, path, where),
    )


def sizes(data: Table, name: str, path: Path) -> tuple[tuple[int, int], tuple[int, int]]:
    """(height, width) of a domain's original RGB and depth images."""
    found = _domain(data, name, path)
    rgb, depth = (_size(found, image, path, f"domains.{name}") for image in ("rgb", "depth"))
    return rgb, depth


def _domain(data: Table, name: str, path: Path) -> Table:
    domains = _table(data.get("domains", {}), path, "domains")
    if name not in domains:
        known = ", ".join(domains) or "none"
        raise RequestError(f"{path}: no [domains.{name}] (has: {known})")
    return _table(domains[name], path, f"domains.{name}")


def _size(found: Table, image: str, path: Path, where: str) -> tuple[int, int]:
    table = {**found, **_table(found.get(image, {}), path, f"{where}.{image}")}
    height, width = (_positive(table, key, path, where) for key in ("height", "width"))
    if height != int(height) or width != int(width):
        raise RequestError(f"{path}: {where}: width and height are whole numbers of pixels")
    if height * width > MOST_PIXELS:
        size = f"{width:.0f}x{height:.0f}"
        raise RequestError(f"{path}: {where}: {size} pixels; at most {MOST_PIXELS:,} are read")
    return int(height), int(width)


def _sources(found: Table, path: Path, where: str) -> dict[str, str]:
    table = _table(found.get("source", {}), path, f"{where}.source")
    if not all(isinstance(value, str) for value in table.values()):
        raise RequestError(f'{path}: {where}.source: "declared" or "estimated" for each group')
    return table


def _camera(found: Table, image: str, frame: tuple[int, int], path: Path, where: str) -> Intrinsics:
    height, width = _size(found, image, path, where)
    where = f"{where}.{image}"
    table = _table(found.get(image, {}), path, where)
    if "hfov" in table:
        hfov = _positive(table, "hfov", path, where)
        if not 1 <= hfov <= 179:
            raise RequestError(f"{path}: {where}: hfov is 1 .. 179 degrees")
        fx = fy = width / 2 / math.tan(math.radians(hfov) / 2)
        cx, cy = width / 2, height / 2
    else:
        fx, fy = (_positive(table, key, path, where) for key in ("fx", "fy"))
        cx, cy = (_number(table, key, path, where) for key in ("cx", "cy"))
    pitch = math.radians(_number({"pitch": 0.0, **table}, "pitch", path, where))
    across, down = frame[1] / width, frame[0] / height
    return Intrinsics(fx * across, fy * down, cx * across, cy * down, pitch)


def _is_four(rectangle: Any) -> bool:
    return isinstance(rectangle, list) and len(rectangle) == len(_EDGES)


def _table(value: Any, path: Path, where: str) -> Table:
    if not isinstance(value, dict):
        raise RequestError(f"{path}: {where} must be a table")
    return value


def _positive(found: Table, key: str, path: Path, where: str) -> float:
    value = _number(found, key, path, where)
    if value <= 0:
        raise RequestError(f"{path}: {where}: {key} must be larger than 0")
    return value


def _number(found: Table, key: str, path: Path, where: str) -> float:
    value = found.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _LIMIT:
        raise RequestError(f"{path}: {where}: {key} must be a number within +-{_LIMIT:g}")
    return float(value)
