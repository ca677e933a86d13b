"""Leases: locks that hold between hosts and on network file systems.

A lease is a file that exactly one process can make (`O_EXCL`). It states who made it, and has a
heartbeat that a thread of the holder renews. `flock` is not used, because some network file systems
grant it to two hosts at once.

A lease is stale when its process has certainly ended (see `process_identity.has_ended`), or when a
waiting process has seen no change of the file for `Timing.limit` seconds by its own monotonic
clock. Clocks of two hosts are never compared to decide that. A stale lease is taken over:

1. The taker makes a claim: a file whose name has the id of the stale lease, with `O_EXCL`. One
   process at a time can hold the claim to end a certain lease, and nobody ends a lease without
   it, its holder included.
2. It reads the lease again, and gives up where its content has changed.
3. It renames the lease to a unique name, compares the content again, and removes it.
4. It removes the claim, and makes its own lease with `O_EXCL`, as everybody else may.

A process that is suspended can lose its lease. It must call `Lease.check` before it publishes:
`check` renews the heartbeat, waits for a claim on the lease to end, and raises StoreBusyError
unless the file is still its own. A taker that made its claim before the renewal is waited for; one
that makes it afterwards sees the new heartbeat. What remains is a process that is suspended between
the check and the next system call, for longer than the limit.
"""

from __future__ import annotations

import datetime
import hashlib
import os
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from typing import Annotated

import msgspec

from s2rstore.errors import RequestError, S2RError, StoreBusyError
from s2rstore.files import process_identity
from s2rstore.files.lock_file import SIZE, Found, LockFile
from s2rstore.files.process_identity import ProcessIdentity
from s2rstore.files.safe_files import LinkError

ReportLine = Callable[[str], object]
_TIME = Annotated[str, msgspec.Meta(pattern=r"\A\d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC\Z")]


@dataclass(frozen=True, slots=True)
class Timing:
    """`interval`: seconds between heartbeats; `limit`: seconds of silence that make a lease stale.

    The limit is several times what network file systems cache the attributes of a file for (up to
    20 s by default in sshfs; NFS asks again at every opening).
    """

    interval: float = 5.0
    limit: float = 60.0
    clock: Callable[[], float] = time.monotonic
    pause: Callable[[float], object] = time.sleep


TIMING = Timing()
COMPUTE_TIMING = Timing(limit=300.0)
"""For processes that compute: compiled code may hold the interpreter lock, and so the heartbeat."""


class _Content(msgspec.Struct, frozen=True):
    """The content of a lease's file, as JSON; times are by the clock of the holder."""

    lease: Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{32}\Z")]
    holder: ProcessIdentity
    since: _TIME
    heartbeat: _TIME
    beats: Annotated[int, msgspec.Meta(ge=0, le=2**62)]

    def encode(self) -> bytes:
        return msgspec.json.encode(self).ljust(SIZE - 1) + b"\n"

    def __str__(self) -> str:
        return f"{self.holder} (since {self.since}, last heartbeat {self.heartbeat})"


_DECODER = msgspec.json.Decoder(_Content)


class Lease:
    """A lease that this process holds; `acquire` makes it."""

    def __init__(self, file: LockFile, what: str, content: _Content, timing: Timing) -> None:
        self._file, self._what, self._content, self._timing = file, what, content, timing
        self._loss: str | None = None
        self._mutex = threading.Lock()
        self._released = threading.Event()
        threading.Thread(target=self._beat, name=f"heartbeat of {what}", daemon=True).start()

    def check(self) -> None:
        """Raise StoreBusyError if the lease was taken over, RequestError if that is unknown.

        Call it directly before a step that others see, such as the replacement of a file.
        """
        with _explained(self._what):
            self._renew()
            self._wait_for_claim()
            if self._loss is None:
                self._loss = self._present_loss()
        self.raise_if_lost()

    def raise_if_lost(self) -> None:
        """Raise StoreBusyError if a heartbeat has found that the lease was taken over.

        Reads no file, and so cannot replace `check`; it ends long work early.
        """
        if self._loss is not None:
            raise StoreBusyError(
                f"{self._what} {self._loss}; this process was suspended, or had no contact with "
                "the file system: run the command again"
            )

    def release(self) -> None:
        """Give the lease back; only its own file is removed.

        Raises StoreBusyError where the lease was taken over in the meantime.
        """
        if self._content.holder.process != os.getpid():
            return  # a fork of the holder
        with self._mutex:
            self._released.set()
        observer = _Observer(self._timing)
        while True:
            self.check()
            with _explained(self._what):
                found = self._file.read()
                try:
                    is_removed = found is not None and _end(self._file, found, observer)
                except OSError:  # no claim can be made on a full disk
                    is_removed = self._file.remove_content(self._content.encode())
            if is_removed:
                return
            self._timing.pause(0.02)

    def _beat(self) -> None:
        while self._loss is None and not self._released.wait(self._timing.interval):
            with suppress(OSError, S2RError):  # the next heartbeat tries again
                self._renew()

    def _renew(self) -> None:
        with self._mutex:
            if self._released.is_set() or self._loss is not None:
                return
            beats = self._content.beats + 1
            content = msgspec.structs.replace(self._content, heartbeat=_now(), beats=beats)
            if self._file.rewrite(self._is_own, content.encode()):
                self._content = content
            else:
                self._loss = self._present_loss() or "was lost"

    def _wait_for_claim(self) -> None:
        """Wait until no process tries to end this lease; a claim without an owner is removed."""
        claim, observer = _claim(self._file, self._content.encode()), _Observer(self._timing)
        while self._loss is None:
            left = claim.read()
            if left is None:
                return
            if _is_stale(claim, left, observer):
                _end(claim, left, observer)
            self._timing.pause(0.02)

    def _present_loss(self) -> str | None:
        found = self._file.read()
        if found is None:
            return "was removed"
        return None if self._is_own(found.content) else f"was taken over by {_holder(found)}"

    def _is_own(self, content: bytes) -> bool:
        return _lease_id(content) == self._content.lease


def acquire(
    file: LockFile,
    what: str,
    timeout: float,
    timing: Timing = TIMING,
    observe: bool = False,
    report_line: ReportLine = lambda line: None,
) -> Lease:
    """Make a lease; wait up to `timeout` seconds while another process holds it.

    `what` names the lock in messages, such as "lab.s2r: the compute lock". With `observe`, a lease
    whose heartbeat seems to be older than the limit by the times of the file system is observed for
    the limit, even where `timeout` is shorter; `report_line` gets a line that says so. Raises
    StoreBusyError that names the holder, RequestError where the lock cannot be made.
    """
    observer = _Observer(timing)
    deadline = timing.clock() + timeout
    pause, is_reported = 0.02, False
    with _explained(what):
        while True:
            content = _new_content()
            if file.create(content.encode()):
                return Lease(file, what, content, timing)
            found = file.read()
            if found is not None and _is_stale(file, found, observer):
                if _end(file, found, observer):
                    continue
            elif found is not None and timing.clock() >= deadline:
                is_silent = _seems_stale(found, timing) and observer.is_unchanged(file, found)
                if not (observe and is_silent):
                    raise StoreBusyError(_busy_message(what, file, found, timing))
                if not is_reported:
                    is_reported = True
                    report_line(
                        f"{what}: {_holder(found)} seems to have stopped; waiting up to "
                        f"{timing.limit:.0f} s for a heartbeat"
                    )
            elif timing.clock() >= deadline + timing.limit:
                raise StoreBusyError(f"{what} exists, and cannot be read; remove {file.path}")
            timing.pause(pause)
            pause = min(2 * pause, 0.5)


@dataclass
class _Observation:
    found: Found
    observed: float
    silent: float = 0.0
    changes: int = 0


@dataclass
class _Observer:
    """How long lock files stay as they are, by the clock of this process.

    The time between two observations counts as one interval at most: a process that was suspended
    itself, perhaps together with the holder, has not observed anything meanwhile.
    """

    timing: Timing
    _files: dict[str, _Observation] = field(default_factory=dict)

    def observe(self, file: LockFile, found: Found) -> _Observation:
        now = self.timing.clock()
        seen = self._files.setdefault(str(file.path), _Observation(found, now))
        if seen.found == found:
            seen.silent += min(now - seen.observed, self.timing.interval)
        else:
            seen.found, seen.silent, seen.changes = found, 0.0, seen.changes + 1
        seen.observed = now
        return seen

    def is_unchanged(self, file: LockFile, found: Found) -> bool:
        """Whether no change was observed since the first observation."""
        return self.observe(file, found).changes == 0


def _is_stale(file: LockFile, found: Found, observer: _Observer) -> bool:
    seen = observer.observe(file, found)
    content = _decoded(found.content)
    if content is not None and process_identity.has_ended(content.holder):
        return True
    return seen.silent >= observer.timing.limit


def _end(file: LockFile, found: Found, observer: _Observer) -> bool:
    """Remove the file of a lease if its content is still `found`; True if this process did it.

    Of several processes that try it at once, at most one removes the file.

    A claim that a killed process has left is ended in the same way, by a claim on the claim.
    """
    claim = _claim(file, found.content)
    if not claim.create(_new_content().encode()):
        left = claim.read()
        if left is not None and _is_stale(claim, left, observer):
            _end(claim, left, observer)
        return False
    try:
        present = file.read()
        if present is None or present.content != found.content:
            return False
        return file.remove_content(found.content)
    finally:
        claim.remove()


def _claim(file: LockFile, content: bytes) -> LockFile:
    return file.beside(f"{_lease_id(content)[:16]}.claim")


def _lease_id(content: bytes) -> str:
    decoded = _decoded(content)
    return hashlib.sha256(content).hexdigest() if decoded is None else decoded.lease


def _decoded(content: bytes) -> _Content | None:
    try:
        return _DECODER.decode(content)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None


def _new_content() -> _Content:
    now = _now()
    return _Content(uuid.uuid4().hex, process_identity.this_process(), now, now, 0)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _seems_stale(found: Found, timing: Timing) -> bool:
    """Whether the file's time is older than the limit, or unusable because clocks differ."""
    return not 0.0 <= time.time() - found.modified / 1e9 <= timing.limit


def _holder(found: Found) -> str:
    content = _decoded(found.content)
    return "an unknown process" if content is None else str(content)


def _busy_message(what: str, file: LockFile, found: Found, timing: Timing) -> str:
    owner, _, name = what.rpartition(": ")
    message = f"{owner}: {_holder(found)} holds {name}; wait for it, or stop it"
    if _seems_stale(found, timing):
        return f"{message}; if it has ended without releasing the lock, remove {file.path}"
    return message


@contextmanager
def _explained(what: str) -> Iterator[None]:
    """Errors say which lock is concerned."""
    try:
        yield
    except (StoreBusyError, LinkError):
        raise
    except OSError as error:
        raise RequestError(f"{what} cannot be opened ({error.strerror})") from error
    except RequestError as error:
        raise RequestError(f"{what} cannot be opened ({error})") from error
