"""Lock files that somebody else has made: any content, links, pipes and folders."""

import json
import os
from pathlib import Path

import pytest

from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files.lease import TIMING
from s2rstore.files.locks import compute_lock, file_lock
from tests.support.lock_clock import LockClock

_HOLDER = {"host": "lab", "boot": "b", "namespace": "n", "process": 5, "start": 7}
_LEASE = {"lease": "0" * 32, "holder": _HOLDER, "since": "2026-01-01 00:00:00 UTC",
          "heartbeat": "2026-01-01 00:00:00 UTC", "beats": 1}  # fmt: skip


def text(**changes: object) -> bytes:
    return json.dumps(_LEASE | changes).encode()


CONTENTS = {
    "empty": b"",
    "not JSON": b"{",
    "huge": b"\0" * 20_000_000,
    "not UTF-8": b"\xff" * 100,
    "control characters": text(holder=_HOLDER | {"host": "\x1b[31mlab"}),
    "markup": text(since="[red]now[/red] "),
    "a path as id": text(lease="../../../outside"),
    "a huge process id": text(holder=_HOLDER | {"process": 10**400}),
    "a line of text": b"process 5 on \x1b[31mlab",
}


@pytest.mark.parametrize("content", CONTENTS.values(), ids=CONTENTS.keys())
def test_an_unreadable_lock_counts_as_held_until_the_limit(tmp_path, content):
    lock = tmp_path / "ledger" / "compute.lock"
    lock.parent.mkdir()
    lock.write_bytes(content)
    clock = LockClock()
    with (
        pytest.raises(StoreBusyError, match="an unknown process holds the compute lock") as caught,
        compute_lock(tmp_path, 1.0, timing=clock.timing),
    ):
        pass
    assert str(caught.value).isprintable()
    with compute_lock(tmp_path, 2 * TIMING.limit, timing=clock.timing) as lease:
        lease.check()
        assert [path.name for path in lock.parent.iterdir()] == ["compute.lock"]
    assert list(lock.parent.iterdir()) == []


def make_link(lock: Path, outside: Path) -> None:
    lock.symlink_to(outside)


def make_folder(lock: Path, outside: Path) -> None:
    lock.mkdir()


def make_pipe(lock: Path, outside: Path) -> None:
    os.mkfifo(lock)


@pytest.mark.parametrize("make", [make_link, make_folder, make_pipe], ids=lambda f: f.__name__)
@pytest.mark.parametrize("is_claim", [False, True], ids=["lock", "claim"])
@pytest.mark.parametrize("in_store", [True, False], ids=["store", "file"])
def test_only_regular_files_are_opened(tmp_path, make, is_claim, in_store):
    outside = tmp_path / "outside"
    outside.write_text("kept")
    folder = tmp_path / "folder"
    lock = folder / ("ledger/compute.lock" if in_store else ".notes.lock")
    lock.parent.mkdir(parents=True)
    if is_claim:
        lock.write_bytes(text())
        make(lock.with_name(f"{lock.name}.{'0' * 16}.claim.partial"), outside)
    else:
        make(lock, outside)
    before = sorted(folder.rglob("*"))
    timing = LockClock().timing
    lease = (
        compute_lock(folder, 1000.0, timing=timing)
        if in_store
        else file_lock(folder / "notes", 1000.0, timing)
    )
    with pytest.raises(RequestError, match=r"symbolic link|not a regular file"), lease:
        pass
    assert outside.read_text() == "kept"
    assert sorted(folder.rglob("*")) == before
