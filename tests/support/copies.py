"""Copies of stores, for tests that write."""

from __future__ import annotations

import shutil
from pathlib import Path


def copy_store(store: Path, target: Path) -> Path:
    """A copy at `target`, which must not exist."""
    return Path(shutil.copytree(store, target))
