"""The files of the store at a path or URL."""

from __future__ import annotations

from pathlib import Path

from s2rstore.files.store_files import LocalFiles, StoreFiles
from s2rstore.remote.store_url import StoreUrl, is_url, parse_url


def store_path(text: str) -> Path:
    """The path of a store as a user types it: a folder, or a URL.

    Raises RequestError for a URL that cannot be that of a store.
    """
    return parse_url(text) if is_url(text) else Path(text)


def open_files(store: str | Path | StoreFiles) -> StoreFiles:
    """Return the file interface of a folder or URL without reading anything.

    Raises RequestError for a URL of another kind, and where a package is missing.
    """
    if isinstance(store, StoreFiles):
        return store
    path = store_path(store) if isinstance(store, str) else store
    if not isinstance(path, StoreUrl):
        return LocalFiles(path)
    from s2rstore.remote.remote_files import RemoteFiles

    return RemoteFiles(path)
