"""Result files are written completely or not at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rtools.common.result_files import check_writable, write_all


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_all_files_are_replaced_or_none(tmp_path):
    (tmp_path / "a").write_text("old")
    write_all({tmp_path / "a": b"new", tmp_path / "b": b"bytes"})
    assert (tmp_path / "a").read_bytes() == b"new"
    assert (tmp_path / "b").read_bytes() == b"bytes"
    assert names(tmp_path) == ["a", "b"]
    missing = tmp_path / "nowhere" / "b"
    with pytest.raises(RequestError, match=r"nowhere/b: No such file or directory"):
        write_all({tmp_path / "a": b"newer", missing: b"newer"})
    assert (tmp_path / "a").read_text() == "new"
    assert names(tmp_path) == ["a", "b"]


def test_a_full_disk_keeps_the_previous_files(tmp_path, monkeypatch):
    def failing_fsync(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "a").write_text("old")
    monkeypatch.setattr(atomic_writes.os, "fsync", failing_fsync)
    with pytest.raises(RequestError, match=r"a: No space left on device"):
        write_all({tmp_path / "a": b"new"})
    assert (tmp_path / "a").read_text() == "old"
    assert names(tmp_path) == ["a"]


@pytest.mark.parametrize(
    ("name", "expected"),
    [("nowhere/f", "--out .*nowhere/f: no such folder as"), ("", "a folder; name a file"),
     ("file/f", "no such folder"), ("ref.json", "is the file of --reference, too")],
)  # fmt: skip
def test_output_paths_are_checked_in_advance(tmp_path, name, expected):
    (tmp_path / "file").touch()
    inputs = {"--reference": tmp_path / "ref.json", "--golden": None}
    check_writable({"--out": tmp_path / "out.json", "--freeze": None}, inputs)
    with pytest.raises(RequestError, match=expected):
        check_writable({"--out": tmp_path / name}, inputs)


def test_a_pipe_a_device_or_the_file_of_another_result_is_not_replaced(tmp_path):
    same_paths = {"--freeze": tmp_path / "f", "--out": tmp_path / "." / "f"}
    with pytest.raises(RequestError, match=r"--out .*is the file of --freeze, too"):
        check_writable(same_paths, {})
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(RequestError, match=r"--out .*pipe: a device or a pipe; name a file"):
        check_writable({"--out": tmp_path / "pipe"}, {})
    (tmp_path / "out").symlink_to(tmp_path / "pipe")
    with pytest.raises(RequestError, match="a device or a pipe"):
        check_writable({"--out": tmp_path / "out"}, {})
