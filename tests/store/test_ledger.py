"""Atomic writes, and the ledger, which accepts no changed file and no torn line as finished."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from s2rstore.arrays import array_writer
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes
from s2rstore.files.ledger import Ledger


def _write_file(root: Path, name: str, content: bytes) -> None:
    (root / name).write_bytes(content)


def test_only_unchanged_files_are_proven(tmp_path):
    _write_file(tmp_path, "a", b"one")
    _write_file(tmp_path, "b", b"two")
    ledger = Ledger(tmp_path)
    ledger.add("unit", [("a", 1), ("b", 1)])
    assert all(ledger.proves(entries) for entries in ledger.by_path().values())
    _write_file(tmp_path, "b", b"twO")
    assert not ledger.proves(ledger.by_path()["b"])
    (tmp_path / "b").unlink()
    assert not ledger.proves(ledger.by_path()["b"])
    assert ledger.proves(ledger.by_path()["a"])
    assert not ledger.proves([])


def test_a_rewritten_file_is_proven_by_its_newest_entry(tmp_path):
    _write_file(tmp_path, "a", b"old")
    Ledger(tmp_path).add("unit", [("a", 1)])
    (file,) = (tmp_path / "ledger").glob("*.jsonl")
    file.rename(file.with_name("zzz-9.jsonl"))
    _write_file(tmp_path, "a", b"new")
    Ledger(tmp_path).add("unit", [("a", 1)])
    ledger = Ledger(tmp_path)
    assert ledger.proves(ledger.by_path()["a"])
    _write_file(tmp_path, "a", b"bad")
    assert not ledger.proves(ledger.by_path()["a"])


@given(cut=st.integers(1, 200))
def test_a_torn_line_is_ignored(tmp_path_factory, cut):
    root = tmp_path_factory.mktemp("ledger")
    _write_file(root, "a", b"one")
    ledger = Ledger(root)
    ledger.add("first", [("a", 1)])
    ledger.add("second", [("a", 1)])
    path = next((root / "ledger").glob("*.jsonl"))
    complete = path.read_bytes()
    path.write_bytes(complete[: max(len(complete) - cut, 0)])
    keys = {entry.key for entry in ledger.entries()}
    assert keys <= {"first", "second"}
    ledger.add("third", [("a", 1)])
    assert keys | {"third"} == {entry.key for entry in ledger.entries()}


def test_an_array_of_another_shape_is_never_overwritten(tmp_path):
    array_writer.create(tmp_path / "a", array_writer.plan_layout(4, (2,), "float32", 2))
    array_writer.create(tmp_path / "a", array_writer.plan_layout(4, (2,), "float32", 2))
    with pytest.raises(RequestError, match="another array"):
        array_writer.create(tmp_path / "a", array_writer.plan_layout(5, (2,), "float32", 2))


def test_an_incomplete_shard_is_refused(tmp_path):
    array_writer.create(tmp_path / "a", array_writer.plan_layout(4, (2,), "float32", 4))
    with pytest.raises(ValueError, match="holds 4 rows"):
        array_writer.write_shard(tmp_path / "a", 0, np.zeros((3, 2), np.float32))


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
