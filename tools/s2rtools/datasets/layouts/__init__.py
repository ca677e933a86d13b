"""Layouts of recordings, one module each, and those that other packages add.

To add a layout, write one module with a `LAYOUT` and add one line to `LAYOUTS`. A package outside
of this project adds one by an entry point of the group `s2r.importers` whose name is that of the
layout and whose object is a `Layout`.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import Layout, ReadOptions, Recording

ENTRY_POINTS = "s2r.importers"
LAYOUTS: dict[str, Layout | str] = {
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
}
"""Layouts by name, or the modules of this package that define them, loaded when they are used."""


def layout_names() -> list[str]:
    """The names of all layouts, those of other packages included."""
    return sorted({*LAYOUTS, *_added()})


def find_layout(name: str) -> Layout:
    """The layout of a name. Raises RequestError if it is unknown or cannot be loaded."""
    own, added = LAYOUTS.get(name), _added()
    where = f"{name!r}"
    if isinstance(own, str):
        layout: object = import_module(f"{__name__}.{own}").LAYOUT
    elif own is not None:
        layout = own
    elif name in added:
        where = added[name].value
        try:
            layout = added[name].load()
        except Exception as error:
            raise RequestError(f"layout {name!r} of {where}: {error}") from error
    else:
        raise RequestError(f"layout {name!r}: unknown; choose from {', '.join(layout_names())}")
    if not isinstance(layout, Layout):
        raise RequestError(f"layout {name!r}: {where} is no s2rtools.datasets.recording.Layout")
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
