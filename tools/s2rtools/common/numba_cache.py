"""numba with a cache that is invalidated if any compiled file changes.

numba checks only the file of a cached function, so a kernel would use outdated code of a function
that it calls from another file. The cache folder is therefore named after the content of all these
files and the versions of the libraries. It lies in `NUMBA_CACHE_DIR` or the user's cache folder,
or in a temporary folder if neither is writable.
"""

from __future__ import annotations

import hashlib
import inspect
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numba
from numba import njit, prange

__all__ = ["cached", "compile_deferred", "njit", "prange"]

_FILES = (
    "incremental_inference/base_pass.py",
    "incremental_inference/fused_update.py",
    "synthetic_world/raycaster.py",
    "synthetic_world/materials.py",
    "sysid/simulators/planar_kernel.py",
)
_LIBRARIES = ("numba", "umap-learn", "pynndescent")


_DEFERRED = "pynndescent"
_deferred: list[tuple[Any, list[Any]]] = []
"""Functions of pynndescent that are not compiled yet, each with its type signatures."""


@contextmanager
def cached() -> Iterator[None]:
    """Cache compiled functions on disk of the libraries that are imported in this context.

    Functions of pynndescent that name their types are compiled by `compile_deferred`, not during
    the import. Compiling umap-learn and pynndescent takes half a minute otherwise, in each process.
    """
    plain = {name: getattr(numba, name) for name in ("jit", "njit")}

    def with_cache(decorate: Callable[..., Any]) -> Callable[..., Any]:
        def decorated(*args: Any, **options: Any) -> Any:
            options = {"cache": True} | options
            compiled = decorate(*args, **options)
            if not args or inspect.isfunction(args[0]):
                return compiled

            def of_function(function: Callable[..., Any]) -> Any:
                is_deferred = function.__module__.partition(".")[0] == _DEFERRED
                if not is_deferred or numba.config.DISABLE_JIT:
                    return compiled(function)
                dispatcher = decorate(**options)(function)
                types = args[0] if isinstance(args[0], list) else [args[0]]
                _deferred.append((dispatcher, types))
                return dispatcher

            return of_function

        return decorated

    try:
        for name, decorate in plain.items():
            setattr(numba, name, with_cache(decorate))
        yield
    finally:
        for name, decorate in plain.items():
            setattr(numba, name, decorate)


def compile_deferred() -> None:
    """Compile the functions that imports in `cached` left out, for the types that they name."""
    while _deferred:
        dispatcher, types = _deferred.pop(0)
        for signature in types:
            dispatcher.compile(signature)
        dispatcher.disable_compile()


def _folder() -> Path:
    package = Path(__file__).parents[1]
    content = b"".join((package / name).read_bytes() for name in _FILES)
    content += " ".join(version(library) for library in _LIBRARIES).encode()
    name = f"s2rtui-{hashlib.sha256(content).hexdigest()[:12]}"
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
