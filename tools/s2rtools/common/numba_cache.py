"""numba with a cache that a change of any compiled file empties.

numba stamps a cached function by its own file alone, so a kernel would go on with the old code of a
function that it calls from another file. The cache therefore lies in a folder that is named by the
content of all of them and the versions of the libraries, under `NUMBA_CACHE_DIR` or the user's
cache; in a temporary folder where those cannot be written.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numba
from numba import njit, prange

__all__ = ["cached", "njit", "prange"]

_FILES = (
    "datasets/jpeg_entropy.py",
    "synthetic_world/raycaster.py",
    "synthetic_world/materials.py",
    "sysid/variable_projection.py",
    "sysid/simulators/planar_kernel.py",
)
_LIBRARIES = ("numba", "umap-learn", "pynndescent")


@contextmanager
def cached() -> Iterator[None]:
    """What is imported inside keeps its compiled functions, although its authors did not ask.

    For libraries that compile themselves anew in each process: umap-learn spends 13 s so.
    """
    plain = {name: getattr(numba, name) for name in ("jit", "njit")}

    def keeping(decorate: Callable[..., Any]) -> Callable[..., Any]:
        return lambda *given, **options: decorate(*given, **{"cache": True} | options)

    try:
        for name, decorate in plain.items():
            setattr(numba, name, keeping(decorate))
        yield
    finally:
        for name, decorate in plain.items():
            setattr(numba, name, decorate)


def _folder() -> Path:
    package = Path(__file__).parents[1]
    told = b"".join((package / name).read_bytes() for name in _FILES)
    told += " ".join(version(library) for library in _LIBRARIES).encode()
    name = f"s2rtui-{hashlib.sha256(told).hexdigest()[:12]}"
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
