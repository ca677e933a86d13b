"""The catalog check runs once per index content; threads open an index at once."""

import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.index import catalog_check, locked_connection


@pytest.fixture
def checked_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Path]:
    """The checked files, in a process that has opened none, with an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    files: list[Path] = []
    check = catalog_check.check

    def recording_check(connection, tables, views, path, database) -> None:
        files.append(path)
        check(connection, tables, views, path, database)

    monkeypatch.setattr(catalog_check, "check", recording_check)
    return files


def open_in_new_process(index: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Open the index as a new process would."""
    monkeypatch.setattr(locked_connection, "_checked", {})
    locked_connection.connect(index).close()


def index_file(store: Path) -> Path:
    return store / layout.read_current(store).index


def test_a_failed_check_is_not_cached(store_copy, checked_files, monkeypatch):
    """The views that the index should have are others than it has, and than were checked before."""
    index = index_file(store_copy)
    open_in_new_process(index, monkeypatch)
    for _ in range(2):
        monkeypatch.setattr(locked_connection, "_checked", {})
        with pytest.raises(RequestError):
            locked_connection.connect(index, views=())
    assert checked_files == [index] * 3


@pytest.mark.parametrize("problem", ["others may write", "a link", "a file"])
def test_a_cache_folder_that_others_can_write_is_not_used(
    store_copy, tmp_path, checked_files, monkeypatch, problem
):
    folder = tmp_path / "cache" / "s2rtui" / "checked-indexes"
    folder.parent.mkdir(parents=True)
    if problem == "a file":
        folder.touch()
    elif problem == "a link":
        (tmp_path / "elsewhere").mkdir()
        folder.symlink_to(tmp_path / "elsewhere")
    else:
        folder.mkdir()
        folder.chmod(0o777)
    index = index_file(store_copy)
    for _ in range(2):
        open_in_new_process(index, monkeypatch)
    assert checked_files == [index, index]


def test_threads_open_an_index_simultaneously(tiny_store):
    index = index_file(tiny_store)
    barrier = threading.Barrier(4)

    def open_index(_: int) -> tuple[object, ...] | None:
        barrier.wait(30)
        connection = locked_connection.connect(index, "128MB")
        barrier.wait(30)
        setting = connection.execute("SELECT current_setting('lock_configuration')").fetchone()
        connection.close()
        return setting

    with ThreadPoolExecutor(4) as pool:
        for _ in range(20):
            assert list(pool.map(open_index, range(4))) == [(True,)] * 4
