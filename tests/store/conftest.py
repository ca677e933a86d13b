"""A store whose rows lie in Parquet files beside the index."""

from pathlib import Path

import pytest

from s2rstore.index import row_files
from s2rstore.index.transaction import edit
from tests.conftest import BuildOnce
from tests.support.copies import copy_store


@pytest.fixture(scope="module")
def source(tiny_store: Path, build_once: BuildOnce) -> Path:
    """The synthetic store with its rows in files."""
    return build_once("rows-source.s2r", lambda path: _file_rows(copy_store(tiny_store, path)))


def _file_rows(root: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(row_files, "MAX_ROWS", 0)
        with edit(root):
            pass
    assert row_files_of(root)


@pytest.fixture
def filed(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A private copy of the store with its rows in files, where they stay."""
    monkeypatch.setattr(row_files, "MAX_ROWS", 0)
    return copy_store(source, tmp_path / "own.s2r")


def row_files_of(root: Path) -> dict[str, int]:
    """The files of rows of a store with their modification times, by paths beside the index."""
    folder = root / "index"
    found = (path for path in (folder / "rows").rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.stat().st_mtime_ns for path in found}


def row_file(root: Path, run: str = "vanilla", table: str = "prediction") -> Path:
    (path,) = (root / "index" / "rows" / table / run).iterdir()
    return path
