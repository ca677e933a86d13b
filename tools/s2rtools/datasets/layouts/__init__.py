"""Layouts of recordings, one module each, and those that other packages add.

To add a layout, write one module with a `LAYOUT` and add one line to `LAYOUTS`. A package outside
of this project adds one by an entry point of the group `s2r.importers` whose name is that of the
layout and whose object is a `Layout`.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.datasets.layouts import (
    bag,
    colmap,
    csv_poses,
    euroc,
    kitti,
    lerobot,
    nerfstudio,
    scannet,
    seven_scenes,
    tum,
)
from s2rtools.datasets.recording import Layout, ReadOptions, Recording

ENTRY_POINTS = "s2r.importers"
LAYOUTS: dict[str, Layout] = {
    "7scenes": seven_scenes.LAYOUT,
    "bag": bag.LAYOUT,
    "colmap": colmap.LAYOUT,
    "csv": csv_poses.LAYOUT,
    "euroc": euroc.LAYOUT,
    "kitti": kitti.LAYOUT,
    "lerobot": lerobot.LAYOUT,
    "nerfstudio": nerfstudio.LAYOUT,
    "scannet": scannet.LAYOUT,
    "tum": tum.LAYOUT,
}


def layout_names() -> list[str]:
    """The names of all layouts, those of other packages included."""
    return sorted({*LAYOUTS, *_added()})


def find_layout(name: str) -> Layout:
    """The layout of a name. Raises RequestError if it is unknown or cannot be loaded."""
    if name in LAYOUTS:
        return LAYOUTS[name]
    if name not in _added():
        raise RequestError(f"layout {name!r}: unknown; choose from {', '.join(layout_names())}")
    entry = _added()[name]
    try:
        layout = entry.load()
    except Exception as error:
        raise RequestError(f"layout {name!r} of {entry.value}: {error}") from error
    if not isinstance(layout, Layout):
        raise RequestError(
            f"layout {name!r}: {entry.value} is no s2rtools.datasets.recording.Layout"
        )
    return layout


def read(layout: str, path: Path | str, options: ReadOptions | None = None) -> Recording:
    """Read a recording: its cameras, poses and the names of its images, which are not decoded.

    Raises RequestError if the layout or an option is unknown or `path` is not such a recording.
    """
    known = find_layout(layout)
    options = options or ReadOptions()
    if unknown := [name for name in options.values if name not in known.options]:
        names = ", ".join(sorted(known.options)) or "none"
        raise RequestError(f"layout {layout}: no option {unknown[0]!r} (has: {names})")
    return known.read(Path(path), options).finish(options)


def _added() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=ENTRY_POINTS)}
