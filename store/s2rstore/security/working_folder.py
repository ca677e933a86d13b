"""Keep files of the working folder from running code in a command, or from changing its results.

The folder that a command is started in may be somebody else's: a store that was sent, a download.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.abc import Loader
    from importlib.machinery import ModuleSpec

SEARCH_PATHS = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")
"""Variables that list folders; an empty entry means the working folder."""
SETTINGS = ("matplotlibrc", ".numba_config.yaml")
"""Files that matplotlib and numba read from the working folder when they are imported."""

_exists = os.path.exists
_hiding = 0
_lock = threading.Lock()


def distrust() -> None:
    """Protect this process and all that it starts; may be called again at any time.

    Child interpreters do not search the working folder for modules, empty entries leave
    `SEARCH_PATHS`, and the libraries that read `SETTINGS` do without. What the interpreter has
    imported before this call is not undone.
    """
    os.environ["PYTHONSAFEPATH"] = "1"
    drop_empty_entries(os.environ)
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Finder())


def drop_empty_entries(environment: MutableMapping[str, str]) -> None:
    """Drop the entries of `SEARCH_PATHS` that stand for the working folder."""
    for name in SEARCH_PATHS:
        before = environment.get(name)
        if before is None:
            continue
        entries = [entry for entry in before.split(os.pathsep) if entry]
        if entries:
            environment[name] = os.pathsep.join(entries)
        else:
            del environment[name]


@contextmanager
def _settings_hidden() -> Iterator[None]:
    """`os.path.exists` denies `SETTINGS` meanwhile: these libraries have no option for it."""
    global _hiding
    with _lock:
        _hiding += 1
        os.path.exists = _exists_elsewhere
    try:
        yield
    finally:
        with _lock:
            _hiding -= 1
            if not _hiding:
                os.path.exists = _exists


def _exists_elsewhere(path: int | str | bytes | os.PathLike[str] | os.PathLike[bytes]) -> bool:
    return path not in SETTINGS and _exists(path)


def _import_unset(module: ModuleType, execute: Callable[[ModuleType], None]) -> None:
    with _settings_hidden():
        execute(module)


def _import_numba_config(module: ModuleType, execute: Callable[[ModuleType], None]) -> None:
    """It looks for its file at every compilation, too, where this name says."""
    _import_unset(module, execute)
    vars(module)["_config_fname"] = os.devnull


def _import_opencv(module: ModuleType, execute: Callable[[ModuleType], None]) -> None:
    """It appends an empty entry to LD_LIBRARY_PATH: children would load libraries from here."""
    execute(module)
    drop_empty_entries(os.environ)


_IMPORTS = {
    "matplotlib": _import_unset,
    "numba.core.config": _import_numba_config,
    "cv2": _import_opencv,
}


class _Finder:
    """Delegates to the other finders, and runs the functions of `_IMPORTS` at the imports."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        careful = _IMPORTS.get(fullname)
        if careful is None:
            return None
        for finder in sys.meta_path:
            spec = None if finder is self else finder.find_spec(fullname, path, target)
            if spec is not None:
                if spec.loader is not None:
                    _wrap(spec.loader, careful)
                return spec
        return None


def _wrap(loader: Loader, careful: Callable[..., None]) -> None:
    execute = loader.exec_module
    vars(loader)["exec_module"] = lambda module: careful(module, execute)
