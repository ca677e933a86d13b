"""Leases: exclusive, taken over only when stale, and noticed by the process that has lost one."""

import json
import os
import subprocess
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import pytest

from bench.support.processes import wait_until
from s2rstore.errors import RequestError, StoreBusyError
from s2rstore.files import process_identity
from s2rstore.files.lease import TIMING, Lease, acquire
from s2rstore.files.lock_file import SIZE, LockFile
from s2rstore.files.locks import compute_lock, file_lock, publish_lock
from tests.hostile.test_ingest_leftovers import ended_process_id
from tests.support.lock_clock import LockClock


@pytest.fixture
def clock() -> LockClock:
    return LockClock()


def write_lease(lock: Path, **holder: Any) -> bytes:
    """The lock file of a process like this one, except for the given facts."""
    own = msgspec.to_builtins(process_identity.this_process())
    when = "2026-01-01 00:00:00 UTC"
    content = {"lease": f"{7:032x}", "holder": {**own, **holder}, "since": when,
               "heartbeat": when, "beats": 3}  # fmt: skip
    encoded = json.dumps(content).encode().ljust(SIZE)
    lock.parent.mkdir(exist_ok=True)
    lock.write_bytes(encoded)
    return encoded


def compute_file(root: Path) -> Path:
    return root / "ledger" / "compute.lock"


def assert_held(
    root: Path, clock: LockClock, timeout: float = 0.0, match: str | None = None
) -> None:
    """Check that the compute lock cannot be taken within some seconds."""
    with (
        pytest.raises(StoreBusyError, match=match),
        compute_lock(root, timeout, timing=clock.timing),
    ):
        pass


def names(root: Path) -> set[str]:
    return {path.name for path in (root / "ledger").iterdir()}


def test_a_lease_excludes_others_until_it_is_released(tmp_path):
    with compute_lock(tmp_path) as lease:
        with pytest.raises(StoreBusyError, match="holds the compute lock"), compute_lock(tmp_path):
            pass
        lease.check()
        with publish_lock(tmp_path) as other:
            other.check()
    assert names(tmp_path) == set()
    with compute_lock(tmp_path):
        assert names(tmp_path) == {"compute.lock"}


def test_the_message_names_the_holder_and_what_to_do(tmp_path):
    write_lease(compute_file(tmp_path), host="elsewhere", process=77)
    with pytest.raises(StoreBusyError) as caught, compute_lock(tmp_path):
        pass
    message = str(caught.value)
    assert message.startswith(f"{tmp_path}: process 77 on elsewhere (since 2026-01-01 00:00:00 UTC")
    assert "wait for it, or stop it" in message
    assert "remove" not in message
    an_hour_ago = time.time() - 3600
    lock = tmp_path / ".notes.json.lock"
    write_lease(lock, host="elsewhere")
    os.utime(lock, (an_hour_ago, an_hour_ago))
    with (
        pytest.raises(StoreBusyError, match=f"remove {lock}"),
        file_lock(tmp_path / "notes.json", timeout=0.0),
    ):
        pass


def test_a_silent_lease_of_another_host_is_taken_over_after_the_limit(tmp_path, clock):
    write_lease(compute_file(tmp_path), host="elsewhere")
    assert_held(tmp_path, clock, TIMING.limit - 2, "elsewhere")
    clock.now = 0.0
    with compute_lock(tmp_path, 2 * TIMING.limit, timing=clock.timing) as lease:
        assert TIMING.limit <= clock.now <= TIMING.limit + 1
        lease.check()
        assert names(tmp_path) == {"compute.lock"}


def test_an_apparently_silent_holder_of_the_compute_lock_is_observed_without_a_timeout(
    tmp_path, clock
):
    lines: list[str] = []
    lock = compute_file(tmp_path)
    for age in (3600, -3600):  # the clock of the file system may be ahead
        write_lease(lock, host="elsewhere")
        os.utime(lock, (time.time() - age,) * 2)
        with compute_lock(tmp_path, 0.0, lines.append, clock.timing) as lease:
            lease.check()
    assert len(lines) == 2
    assert all("elsewhere" in line and "60 s" in line for line in lines)


@pytest.mark.parametrize("offset", [-86_400.0, 86_400.0], ids=["behind", "ahead"])
def test_a_live_holder_is_never_taken_over_whatever_its_clock(tmp_path, clock, offset):
    with compute_lock(tmp_path) as lease:
        last = 0.0

        def beat() -> None:
            nonlocal last
            if clock.now - last >= TIMING.interval:
                last = clock.now
                lease.check()
            os.utime(compute_file(tmp_path), (time.time() + offset + clock.now,) * 2)

        clock.during_pause = beat
        assert_held(tmp_path, clock, 10 * TIMING.limit)
        assert clock.now >= 10 * TIMING.limit
        assert_held(tmp_path, clock)
        lease.check()


def test_time_in_which_the_waiting_process_was_suspended_does_not_count(tmp_path, clock):
    write_lease(compute_file(tmp_path), host="elsewhere")

    def sleep_long() -> None:
        clock.now += 1000.0

    clock.during_pause = sleep_long
    with compute_lock(tmp_path, 1e6, timing=clock.timing):
        assert clock.pauses >= TIMING.limit / TIMING.interval


@pytest.mark.parametrize("is_reaped", [True, False])
def test_the_lease_of_a_killed_process_is_taken_over_at_once(tmp_path, clock, is_reaped):
    process = subprocess.Popen(["sleep", "600"])
    start, _ = process_identity._start_and_state(process.pid) or (0, "")
    write_lease(compute_file(tmp_path), process=process.pid, start=start)
    assert_held(tmp_path, clock)
    process.kill()
    os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
    if is_reaped:
        process.wait()
    with compute_lock(tmp_path, 0.0, timing=clock.timing) as lease:
        lease.check()
    assert clock.now == 0.0
    process.wait()


@pytest.mark.parametrize("other", [{"boot": "other"}, {"namespace": "pid:[1]"}, {"host": "other"}])
def test_a_process_of_another_boot_container_or_host_may_still_run(tmp_path, clock, other):
    write_lease(compute_file(tmp_path), process=ended_process_id(), **other)
    assert_held(tmp_path, clock)
    reused = {"start": process_identity.this_process().start - 1}
    for ended in ({"process": ended_process_id()}, reused):
        write_lease(compute_file(tmp_path), **ended)
        with compute_lock(tmp_path, 0.0, timing=clock.timing):
            pass


def test_a_holder_notices_that_its_lease_was_taken_over(tmp_path, clock):
    lost = acquire(LockFile(compute_file(tmp_path), tmp_path), "lab.s2r: the compute lock", 0.0)
    with compute_lock(tmp_path, 1000.0, timing=clock.timing) as taken:
        for _ in range(2):
            with pytest.raises(StoreBusyError, match="taken over by process"):
                lost.check()
        with pytest.raises(StoreBusyError, match="run the command again"):
            lost.raise_if_lost()
        with pytest.raises(StoreBusyError):
            lost.release()
        taken.check()
    with compute_lock(tmp_path) as third:
        with pytest.raises(StoreBusyError):
            lost.release()
        third.check()
    assert names(tmp_path) == set()


def test_a_holder_notices_that_its_lease_was_removed(tmp_path):
    with pytest.raises(StoreBusyError, match="removed"), compute_lock(tmp_path):
        compute_file(tmp_path).unlink()


def test_the_error_of_the_holder_is_reported_rather_than_its_lost_lease(tmp_path):
    with pytest.raises(ZeroDivisionError), compute_lock(tmp_path):  # noqa: PT012
        compute_file(tmp_path).unlink()
        raise ZeroDivisionError


def test_the_heartbeat_is_renewed_by_a_thread(tmp_path):
    file = LockFile(tmp_path / "lock")
    lease = acquire(file, f"{tmp_path}: the lock", 0.0, replace(TIMING, interval=0.01))
    before = file.read()
    assert wait_until(lambda: file.read() != before, interval=0.01)
    lease.release()
    assert file.read() is None


def test_a_taker_that_comes_too_late_leaves_the_new_lease(tmp_path):
    stale = write_lease(compute_file(tmp_path), process=ended_process_id())
    with compute_lock(tmp_path) as lease:
        file = LockFile(compute_file(tmp_path), tmp_path)
        assert not file.remove_content(stale)
        lease.check()
        assert names(tmp_path) == {"compute.lock"}


def test_a_holder_that_wakes_before_the_claim_keeps_its_lease(tmp_path, clock, monkeypatch):
    create = LockFile.create
    with compute_lock(tmp_path) as lease:

        def wake_before(file: LockFile, content: bytes) -> bool:
            if "claim" in file.path.name:
                monkeypatch.undo()
                lease.check()
            return create(file, content)

        monkeypatch.setattr(LockFile, "create", wake_before)
        assert_held(tmp_path, clock, TIMING.limit)
        assert LockFile.create is create
        lease.check()
        assert names(tmp_path) == {"compute.lock"}


def test_a_holder_that_wakes_during_a_takeover_waits_for_its_end(tmp_path, clock, monkeypatch):
    errors: list[Exception] = []
    threads: list[threading.Thread] = []
    claim_was_seen = threading.Event()
    read, remove_content = LockFile.read, LockFile.remove_content

    def wake(lease: Lease) -> None:
        try:
            lease.check()
        except StoreBusyError as error:
            errors.append(error)

    def watched_read(file: LockFile) -> Any:
        found = read(file)
        if found and "claim" in file.path.name and threading.current_thread() in threads:
            claim_was_seen.set()
        return found

    with compute_lock(tmp_path) as lease:

        def wake_within(file: LockFile, content: bytes) -> bool:
            if not threads:  # the taker has found that the heartbeat is unchanged
                threads.append(threading.Thread(target=wake, args=(lease,)))
                threads[0].start()
                assert claim_was_seen.wait(30)
                assert threads[0].is_alive()
            return remove_content(file, content)

        monkeypatch.setattr(LockFile, "read", watched_read)
        monkeypatch.setattr(LockFile, "remove_content", wake_within)
        assert_held(tmp_path, clock, TIMING.limit)
        threads[0].join(30)
        assert errors == []
        lease.check()
    assert names(tmp_path) == set()


@pytest.mark.parametrize("is_ended", [True, False])
def test_a_claim_that_a_killed_taker_left_is_removed(tmp_path, clock, is_ended):
    """A lease is stale, and so is the claim on it."""
    write_lease(compute_file(tmp_path), process=ended_process_id())
    claim = tmp_path / "ledger" / f"compute.lock.{7:032x}"[:-16]
    claim = claim.with_name(f"{claim.name}.claim.partial")
    write_lease(claim, **({"process": ended_process_id()} if is_ended else {"host": "elsewhere"}))
    with compute_lock(tmp_path, 0.0, timing=clock.timing) as lease:
        assert (clock.now < 1) == is_ended
        lease.check()
        assert names(tmp_path) == {"compute.lock"}


def test_a_lease_is_released_on_a_full_disk(tmp_path, monkeypatch):
    def refuse(*_: object) -> bool:
        raise OSError(28, "No space left on device")

    with compute_lock(tmp_path):
        monkeypatch.setattr(LockFile, "create", refuse)
    assert names(tmp_path) == set()


def test_a_read_only_folder_is_reported(tmp_path, monkeypatch):
    def refuse(*_: object, **__: object) -> int:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(os, "mkdir", refuse)
    with (
        pytest.raises(RequestError, match=r"compute lock cannot be opened \(Read-only file system"),
        compute_lock(tmp_path),
    ):
        pass
