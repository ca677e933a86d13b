"""The data file beside the images: bounds, rooms and cameras, as TOML or JSON.

    name = "office"             y_down = true          accuracy_scale = 26.0   (optional, m)
    [bounds]                    x0, y0, x1, y1 in metres
    floor_plan = "map.png"      picture that fills the bounds (optional)
    [[rooms]]                   room = "hall", rectangles = [[x0, y0, x1, y1], ...]  (optional)
    [domains.NAME]              kind = "sim" | "real", width, height of the original images,
                                rgb = { hfov | fx, fy, cx, cy; pitch }, depth = { ... },
                                camera_height, forward_offset, depth_scale, depth_raw_min,
                                depth_raw_max, source = { ... }  (optional)

Angles in degrees, intrinsics in pixels of the original images with pixel i covering [i, i + 1).
"""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any

from s2rstore.errors import RequestError
from s2rstore.layout import checked_name
from s2rstore.records import Bounds, Domain, Intrinsics, Room


def read(path: Path) -> dict[str, Any]:
    """Raises RequestError naming the file and line where it cannot be read."""
    try:
        text = path.read_text()
        return json.loads(text) if path.suffix == ".json" else tomllib.loads(text)
    except OSError as error:
        raise RequestError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise RequestError(f"{path}: {error}") from error


def bounds(data: dict[str, Any], path: Path) -> Bounds:
    edges = [_number(data.get("bounds", {}), name, path, "bounds") for name in _EDGES]
    if edges[2] <= edges[0] or edges[3] <= edges[1]:
        raise RequestError(f"{path}: bounds: x1 and y1 must be larger than x0 and y0")
    return Bounds(*edges)


_EDGES = ("x0", "y0", "x1", "y1")


def rooms(data: dict[str, Any], path: Path) -> tuple[Room, ...]:
    """Rectangles in order of precedence."""
    made: list[Room] = []
    for entry in data.get("rooms", ()):
        for rectangle in entry.get("rectangles", ()):
            if len(rectangle) != 4:
                raise RequestError(f"{path}: room {entry.get('room')!r}: rectangles are 4 numbers")
            made.append(Room(str(entry["room"]), len(made), *map(float, rectangle)))
    return tuple(made)


def domain(data: dict[str, Any], name: str, frame: tuple[int, int], path: Path) -> Domain:
    """The cameras of one domain, scaled to frames of (height, width)."""
    found = data.get("domains", {}).get(name)
    if found is None:
        known = ", ".join(data.get("domains", {})) or "none"
        raise RequestError(f"{path}: no [domains.{name}] (has: {known})")
    where = f"domains.{name}"
    if found.get("kind") not in ("sim", "real"):
        raise RequestError(f'{path}: {where}: kind = "sim" or "real"')
    width, height = (_number(found, key, path, where) for key in ("width", "height"))
    scale = frame[1] / width, frame[0] / height
    return Domain(
        domain=checked_name(name, "domain"),
        kind=found["kind"],
        rgb=_camera(found.get("rgb", {}), (width, height), scale, path, f"{where}.rgb"),
        depth=_camera(found.get("depth", {}), (width, height), scale, path, f"{where}.depth"),
        camera_height=_number(found, "camera_height", path, where),
        forward_offset=float(found.get("forward_offset", 0.0)),
        depth_scale=_number(found, "depth_scale", path, where),
        depth_raw_min=int(found.get("depth_raw_min", 1)),
        depth_raw_max=int(found.get("depth_raw_max", 65534)),
        sources=dict(found.get("source", {})),
    )


def size(data: dict[str, Any], name: str) -> tuple[int, int]:
    """(height, width) of a domain's original images."""
    found = data["domains"][name]
    return int(found["height"]), int(found["width"])


def _camera(
    found: dict[str, Any],
    original: tuple[float, float],
    scale: tuple[float, float],
    path: Path,
    where: str,
) -> Intrinsics:
    if "hfov" in found:
        fx = fy = original[0] / 2 / math.tan(math.radians(_number(found, "hfov", path, where)) / 2)
        cx, cy = original[0] / 2, original[1] / 2
    else:
        fx, fy, cx, cy = (_number(found, key, path, where) for key in ("fx", "fy", "cx", "cy"))
    pitch = math.radians(float(found.get("pitch", 0.0)))
    return Intrinsics(fx * scale[0], fy * scale[1], cx * scale[0], cy * scale[1], pitch)


def _number(found: dict[str, Any], key: str, path: Path, where: str) -> float:
    value = found.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise RequestError(f"{path}: {where}: {key} must be a number")
    return float(value)
