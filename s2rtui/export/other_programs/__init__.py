"""Files for other programs: a format is a module here and a line of `FORMATS`.

Such a module has a function `write(content, path)`. It writes what `ExportContent` holds, and may
raise ModuleNotFoundError where a package is missing.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from s2rstore.errors import RequestError, missing_package
from s2rtui.export.other_programs.content import ExportContent

__all__ = ["FORMATS", "ExportContent", "Format", "write"]


@dataclass(frozen=True, slots=True)
class Format:
    """A format: its module, what it writes, and whether that needs poses.

    suffix: of the file; empty for a folder. package: name of a Python package that it needs.
    """

    module: str
    description: str
    suffix: str = ""
    package: str = ""
    needs_poses: bool = True


FORMATS: dict[str, Format] = {
    "rerun": Format("rerun_recording", "a recording for Rerun", ".rrd", "rerun-sdk"),
    "mcap": Format("mcap_recording", "a recording for Foxglove", ".mcap", "mcap"),
    "tum": Format("tum_trajectories", "a folder of trajectories for evo"),
    "coco": Format("coco_images", "a folder of images with COCO annotations", needs_poses=False),
    "fiftyone": Format("fiftyone_samples", "a folder of samples for FiftyOne", needs_poses=False),
    "csv": Format("csv_rows", "rows with all fields, tags and notes", ".csv", needs_poses=False),
}
"""Formats by the name that `s2r export --to` takes."""


def write(name: str, content: ExportContent, path: Path) -> None:
    """Write a new file or folder in a format of `FORMATS`.

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
    is_written = False
    try:
        module = import_module(f"{__name__}.{form.module}")
        writer: Callable[[ExportContent, Path], None] = module.write
        if not form.suffix:
            path.mkdir(parents=True)
        writer(content, path)
        is_written = True
    except ModuleNotFoundError as error:
        if not form.package or (error.name or "").startswith("s2r"):
            raise
        raise missing_package(form.package, "viewers") from None
    except OSError as error:
        raise RequestError(f"--out {path}: cannot be written ({error.strerror})") from error
    finally:
        if not is_written:
            _remove(path)


def _remove(path: Path) -> None:
    """Remove what was written before an error."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
