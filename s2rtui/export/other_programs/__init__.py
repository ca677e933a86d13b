"""Files for other programs: a format is a module here and a line of `FORMATS`.

Such a module has a function `write(content, path)`. It writes what `ExportContent` holds, and may
raise ModuleNotFoundError where a package is missing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from s2rstore.errors import RequestError, missing_package
from s2rtui.export.exclusive_files import create_exclusive
from s2rtui.export.other_programs.content import ExportContent

__all__ = ["FORMATS", "ExportContent", "Format", "write"]


@dataclass(frozen=True, slots=True)
class Format:
    """A format: its module, what it writes, and whether that needs poses and can have heat.

    suffix: of the file; empty for a folder. package: name of a Python package that it needs.
    """

    module: str
    description: str
    suffix: str = ""
    package: str = ""
    needs_poses: bool = True
    has_heat: bool = False


FORMATS: dict[str, Format] = {
    "rerun": Format("rerun_recording", "a recording for Rerun", ".rrd", "rerun-sdk", has_heat=True),
    "mcap": Format("mcap_recording", "a recording for Foxglove", ".mcap", "mcap", has_heat=True),
    "tum": Format("tum_trajectories", "a folder of trajectories for evo"),
    "coco": Format("coco_images", "a folder of images with COCO annotations", needs_poses=False),
    "fiftyone": Format("fiftyone_samples", "a folder of samples for FiftyOne", needs_poses=False),
    "csv": Format("csv_rows", "rows with all fields, tags and notes", ".csv", needs_poses=False),
}
"""Formats by the name that `s2r export --to` takes."""


def write(name: str, content: ExportContent, path: Path) -> None:
    """Write a new file or folder in a format of `FORMATS`; it appears when it is complete.

    Raises RequestError where the data set lacks poses or a package is missing, for another suffix,
    and where the file or folder cannot be made.
    """
    form = FORMATS[name]
    if form.needs_poses:
        content.store.require_poses(f"--to {name}")
    if form.suffix and path.suffix != form.suffix:
        raise RequestError(f"--out {path}: must end in {form.suffix}")
    if path.exists() or path.is_symlink():
        raise RequestError(f"--out {path}: exists already")
    if form.suffix and not path.parent.is_dir():
        raise RequestError(f"--out {path}: there is no folder {path.parent}")
    try:
        module = import_module(f"{__name__}.{form.module}")
        writer: Callable[[ExportContent, Path], None] = module.write

        def fill(temporary: Path) -> None:
            if not form.suffix:
                temporary.mkdir(parents=True)
            writer(content, temporary)

        create_exclusive(path, fill)
    except ModuleNotFoundError as error:
        if not form.package or (error.name or "").startswith("s2r"):
            raise
        raise missing_package(form.package, "viewers") from None
    except OSError as error:
        raise RequestError(f"--out {path}: cannot be written ({error.strerror})") from error
