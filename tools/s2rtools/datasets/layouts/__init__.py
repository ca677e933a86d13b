"""Layouts of recordings, one module each, and those that other packages add.

To add a layout, write one module with a `LAYOUT` and add one line to `_MODULES`. A package
outside of this project adds one by an entry point of the group `s2r.layouts` whose name is that of
the layout and whose object is a `Layout`.
"""

from __future__ import annotations

from pathlib import Path

from s2rstore.errors import RequestError
from s2rstore.plugins import Registry, instance_of
from s2rtools.datasets.recording import Layout, ReadOptions, Recording

_MODULES = {
    "7scenes": "seven_scenes",
    "bag": "bag",
    "colmap": "colmap",
    "csv": "csv_poses",
    "euroc": "euroc",
    "kitti": "kitti",
    "lerobot": "lerobot",
    "nerfstudio": "nerfstudio",
    "polycam": "polycam",
    "scannet": "scannet",
    "tum": "tum",
    "video": "video",
}
"""The modules of this package that define layouts, loaded when they are used."""
LAYOUTS = Registry[Layout](
    "layout",
    {name: f"{__name__}.{module}:LAYOUT" for name, module in _MODULES.items()},
    instance_of(Layout),
)


def read(layout: str, path: Path | str, options: ReadOptions | None = None) -> Recording:
    """Read a recording: its cameras, poses and the names of its images, which are not decoded.

    Raises RequestError if the layout or an option is unknown or `path` is not such a recording.
    """
    known = LAYOUTS.find(layout)
    options = options or ReadOptions()
    if unknown := [name for name in options.values if name not in known.options]:
        names = ", ".join(sorted(known.options)) or "none"
        raise RequestError(f"layout {layout}: no option {unknown[0]!r} (has: {names})")
    return known.read(Path(path), options).finish(options)
