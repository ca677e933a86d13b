"""numba with a cache that a change of any compiled file empties.

numba stamps a cached function by its own file alone, so a kernel would go on with the old code of a
function that it calls from another file. The cache therefore lies in a folder that is named by the
content of all of them, under `NUMBA_CACHE_DIR` or the user's cache; in a temporary folder where
those cannot be written.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

import numba
from numba import njit, prange

__all__ = ["njit", "prange"]

_FILES = ("kernel.py", "materials.py")


def _folder() -> Path:
    here = Path(__file__).parent
    digest = hashlib.sha256(b"".join((here / name).read_bytes() for name in _FILES))
    name = f"s2rtui-{digest.hexdigest()[:12]}"
    cache = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    for parent in (os.environ.get("NUMBA_CACHE_DIR"), f"{cache}/numba"):
        if parent:
            folder = Path(parent) / name
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError:
                continue
            if os.access(folder, os.W_OK):
                return folder
    return Path(tempfile.mkdtemp(prefix="s2rtui-numba-"))


numba.config.CACHE_DIR = str(_folder())
