"""A synthetic store on a web server of this machine."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from bench.support.store_server import StoreServer, store_server


@dataclass(frozen=True, slots=True)
class ServedStore:
    """A store in a folder, its URL, and the server."""

    path: Path
    url: str
    server: StoreServer


@pytest.fixture(autouse=True)
def cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of its own for every test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "s2rtui" / "remote"


@pytest.fixture(scope="module")
def web_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StoreServer]:
    with store_server(tmp_path_factory.mktemp("www")) as server:
        yield server


@pytest.fixture
def served(store_copy: Path, web_server: StoreServer) -> Iterator[ServedStore]:
    """A private store on the server, which starts without faults and requests."""
    folder = web_server.root / f"{len(list(web_server.root.iterdir()))}"
    folder.mkdir()
    store_copy.rename(folder / "own.s2r")
    web_server.heal()
    web_server.requests.clear()
    web_server.released.clear()
    yield ServedStore(folder / "own.s2r", f"{web_server.url}/{folder.name}/own.s2r", web_server)
    web_server.released.set()
