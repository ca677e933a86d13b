"""Where a user's own things live."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path


def own_folder(environment: Mapping[str, str] | None = None) -> Path:
    """The user's own folder: `$XDG_DATA_HOME/s2rtui`, by default `~/.local/share/s2rtui`."""
    env = os.environ if environment is None else environment
    named = Path(env.get("XDG_DATA_HOME", ""))
    base = named if named.is_absolute() else Path.home() / ".local" / "share"
    return base / "s2rtui"
