"""Names of folders, trajectories and files of recordings."""

from __future__ import annotations

import re
from pathlib import Path

from s2rstore.errors import RequestError

_MAX_NAME = 80
_PARTS = re.compile(r"([0-9]+)|([^0-9]+)")


def existing_folder(path: Path) -> Path:
    """The path. Raises RequestError unless it is a folder."""
    if not path.is_dir():
        kind = "not a folder" if path.exists() else "no such folder"
        raise RequestError(f"{path}: {kind}")
    return path


def folder_name(path: Path) -> str:
    """The name of a folder, also of `.`, as it is reported."""
    return path.name or path.resolve().name or "recording"


def trajectory_name(text: str) -> str:
    """The text as the name of a trajectory: other characters than letters and digits are `_`."""
    name = re.sub(r"\.\.+", ".", re.sub(r"[^A-Za-z0-9_.+-]", "_", text)).lstrip("_.+-")
    return name[:_MAX_NAME] or "recording"


def natural_order(name: str) -> list[tuple[int, str]]:
    """The key that sorts names by the numbers in them, so that 2.png comes before 10.png."""
    parts = ((number.lstrip("0"), text) for number, text in _PARTS.findall(name))
    return [(-1, text) if text else (len(number), number) for number, text in parts]
