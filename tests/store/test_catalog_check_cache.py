"""A file is compared with the known catalog once per content, and again where anything differs."""

from __future__ import annotations

from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.files import layout
from s2rstore.index import catalog_check, catalog_check_cache, locked_connection
from tests.support.copies import copy_store


@pytest.fixture
def compared(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Path]:
    """The files that were compared, in a process that has opened none and with an empty cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    found: list[Path] = []
    check = catalog_check.check

    def noted(connection, tables, views, path) -> None:
        found.append(path)
        check(connection, tables, views, path)

    monkeypatch.setattr(catalog_check, "check", noted)
    return found


def opened(index: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Open it as a new process would."""
    monkeypatch.setattr(locked_connection, "_checked", {})
    locked_connection.connect(index).close()


def index_of(store: Path) -> Path:
    return store / layout.read_current(store).index


def test_equal_content_is_compared_once(
    store_copy: Path, tmp_path: Path, compared: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    other = index_of(copy_store(store_copy, tmp_path / "other.s2r"))
    opened(index_of(store_copy), monkeypatch)
    opened(index_of(store_copy), monkeypatch)
    opened(other, monkeypatch)
    assert compared == [index_of(store_copy)]


def test_another_expectation_is_compared_again(
    store_copy: Path, compared: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    index = index_of(store_copy)
    opened(index, monkeypatch)
    monkeypatch.setattr(locked_connection, "_checked", {})
    with pytest.raises(RequestError):
        locked_connection.connect(index, views=())
    assert compared == [index, index]


def test_what_was_refused_is_not_remembered(
    store_copy: Path, compared: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    index = index_of(store_copy)
    for _ in range(2):
        monkeypatch.setattr(locked_connection, "_checked", {})
        with pytest.raises(RequestError):
            locked_connection.connect(index, views=())
    assert compared == [index, index]


@pytest.mark.parametrize("trouble", ["others may write", "a link", "a file"])
def test_a_folder_that_is_not_the_users_alone_is_not_used(
    store_copy: Path,
    tmp_path: Path,
    compared: list[Path],
    monkeypatch: pytest.MonkeyPatch,
    trouble: str,
) -> None:
    folder = tmp_path / "cache" / "s2rtui" / "checked-indexes"
    folder.parent.mkdir(parents=True)
    if trouble == "a file":
        folder.touch()
    elif trouble == "a link":
        (tmp_path / "elsewhere").mkdir()
        folder.symlink_to(tmp_path / "elsewhere")
    else:
        folder.mkdir()
        folder.chmod(0o777)
    index = index_of(store_copy)
    for _ in range(2):
        opened(index, monkeypatch)
    assert compared == [index, index]


def test_the_folder_stays_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    names = [f"{number:064x}" for number in range(catalog_check_cache.MAX_ENTRIES + 1)]
    for name in names:
        catalog_check_cache.add(name)
    assert [name for name in names if catalog_check_cache.contains(name)] == names[-1:]
