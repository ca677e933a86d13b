"""Files of the user, outside any store: notebooks with saved selections, notes and tags."""

from __future__ import annotations

import os
from pathlib import Path


def user_data_dir() -> Path:
    """Return `$XDG_DATA_HOME/s2rtui`, by default `~/.local/share/s2rtui`."""
    data_home = Path(os.environ.get("XDG_DATA_HOME", ""))
    if not data_home.is_absolute():
        data_home = Path.home() / ".local" / "share"
    return data_home / "s2rtui"


def is_first_start() -> bool:
    """Return True once per user: when the application starts for the first time."""
    marker = user_data_dir() / "toured"
    if marker.exists():
        return False
    try:
        marker.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        marker.touch()
    except OSError:
        return False
    return True
