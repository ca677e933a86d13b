"""Files are written atomically, and a failed write leaves no temporary file."""

import os

import pytest

from s2rstore.files import atomic_writes


def test_a_file_is_replaced_without_a_temporary_file(tmp_path):
    path = tmp_path / "file"
    for content in (b"one", b"two"):
        atomic_writes.write_file(path, content)
        assert path.read_bytes() == content
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_a_failed_write_keeps_the_old_content(tmp_path, monkeypatch, error):
    path = tmp_path / "file"
    atomic_writes.write_file(path, b"old")

    def failing_fsync(descriptor: int) -> None:
        raise error

    monkeypatch.setattr(os, "fsync", failing_fsync)
    with pytest.raises(type(error)):
        atomic_writes.write_file(path, b"new")
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
