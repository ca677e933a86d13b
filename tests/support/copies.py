"""Copy stores for tests that modify them."""

import shutil
from pathlib import Path


def copy_store(store: Path, target: Path) -> Path:
    """Copy a store to `target`, which must not exist; without locks that other tests hold."""
    return Path(shutil.copytree(store, target, ignore=shutil.ignore_patterns("*.lock")))
