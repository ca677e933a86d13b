"""Leases: locks that hold between hosts, on network file systems and in object storage.

A lease is a file or an object that exactly one process can make. It states who made it, and has a
heartbeat that a thread of the holder renews. It does not rely on `flock`, which some network file
systems grant to two hosts at once.

A lease is stale when its process has certainly ended (see `process_identity.has_ended`), or when a
waiting process has seen no change of it for `Timing.limit` seconds by its own monotonic clock.
Clocks of two hosts are never compared to decide that. A stale lease is taken over by a
compare-and-swap (`LeasePlace.swap`): it is replaced only if its content is still the one observed.

A process that is suspended can lose its lease. It must call `Lease.check` before it publishes:
`check` renews the heartbeat and then raises StoreBusyError unless the lease is still its own. A
process that takes it over at that moment either sees the new heartbeat, and leaves the lease, or
has replaced it already, which `check` sees. What remains is a process that is suspended between the
check and the next system call, for longer than the limit.
"""

from __future__ import annotations

import datetime
import os
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, Protocol

import msgspec

from s2rstore.errors import RequestError, S2RError, StoreBusyError
from s2rstore.files import process_identity
from s2rstore.files.process_identity import ProcessIdentity
from s2rstore.files.safe_files import LinkError

ReportLine = Callable[[str], object]
SIZE = 1024
"""Bytes of a lease, and the most that are read of any."""
RELEASED = b"released"
"""The content of a lease that was given back, where it cannot be removed."""
_PAUSE, _LOOKS = 0.02, 25
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


class Found(NamedTuple):
    """The content of a lease, and when it was modified, in nanoseconds since 1970.

    `modified` is by the clock of the file system or server. `version` is that of an object, with
    which it is replaced.
    """

    content: bytes
    modified: int
    version: str = ""


class LeasePlace(Protocol):
    """Where a lease is kept; `path` names it in messages. Only `SIZE` bytes of it are read."""

    @property
    def path(self) -> Any: ...

    def read(self) -> Found | None:
        """The present lease; None where there is none."""

    def swap(self, found: Found | None, content: bytes | None) -> bool:
        """Replace the lease `found`, or none, by `content`, or by none.

        False where another lease is there. Of several processes that try it, one succeeds at most.
        """

    def renew(self, is_own: Callable[[bytes], bool], content: bytes) -> bool:
        """Write the lease again if `is_own` accepts the present one; False where it does not."""


class _Content(msgspec.Struct, frozen=True):
    """The content of a lease, as JSON; times are by the clock of the holder."""

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

    def __init__(self, place: LeasePlace, what: str, content: _Content, timing: Timing) -> None:
        self._place, self._what, self._content, self._timing = place, what, content, timing
        self._loss: str | None = None
        self._renewed = timing.clock()
        self._mutex = threading.Lock()
        self._released = threading.Event()
        threading.Thread(target=self._beat, name=f"heartbeat of {what}", daemon=True).start()

    def check(self) -> None:
        """Raise StoreBusyError if the lease was taken over, RequestError if that is unknown.

        Call it directly before a step that others see, such as the replacement of a file.
        """
        with _explained(self._what):
            self._renew()
            if self._loss is None:
                self._loss = self._present_loss()
        if self._loss is not None:
            raise StoreBusyError(
                f"{self._what} {self._loss}; this process was suspended, or had no contact with "
                "the file system or server: run the command again"
            )

    def check_at_times(self) -> None:
        """As `check`, but without reading the lease where the last heartbeat is recent.

        It ends long work early, and cannot replace `check`.
        """
        is_recent = self._timing.clock() <= self._renewed + self._timing.limit / 2
        if self._loss is not None or not is_recent:
            self.check()

    def release(self) -> None:
        """Give the lease back; another one in its place stays.

        Raises StoreBusyError where the lease was taken over in the meantime.
        """
        if self._content.holder.process != os.getpid():
            return  # a fork of the holder
        with self._mutex:
            self._released.set()
        while True:
            self.check()
            with _explained(self._what):
                found = self._place.read()
                if found is not None and self._place.swap(found, None):
                    return
            self._timing.pause(_PAUSE)

    def _beat(self) -> None:
        while self._loss is None and not self._released.wait(self._timing.interval):
            with suppress(OSError, S2RError):  # the next heartbeat tries again
                self._renew()

    def _renew(self) -> None:
        with self._mutex:
            if self._released.is_set():
                return
            beats = self._content.beats + 1
            content = msgspec.structs.replace(self._content, heartbeat=_now(), beats=beats)
            while self._loss is None:
                if self._place.renew(self._is_own, content.encode()):
                    self._content, self._renewed = content, self._timing.clock()
                    return
                self._loss = self._present_loss()

    def _present_loss(self) -> str | None:
        """What has become of the lease; None where it is still the own one.

        A missing one is looked for again: `LockFile.swap` moves a file away while it compares it.
        """
        for _ in range(_LOOKS):
            found = self._place.read()
            if found is not None:
                return (
                    None if self._is_own(found.content) else f"was taken over by {_holder(found)}"
                )
            self._timing.pause(_PAUSE)
        return "was removed"

    def _is_own(self, content: bytes) -> bool:
        decoded = _decoded(content)
        return decoded is not None and decoded.lease == self._content.lease


def acquire(
    place: LeasePlace,
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
    pause, is_reported = _PAUSE, False
    with _explained(what):
        while True:
            found = place.read()
            if found is None or observer.is_stale(found):
                content = _new_content()
                if place.swap(found, content.encode()):
                    return Lease(place, what, content, timing)
                if found is None and timing.clock() >= deadline + timing.limit:
                    message = f"{what} exists, and cannot be read; remove {place.path}"
                    raise StoreBusyError(message)
            elif timing.clock() >= deadline:
                is_silent = _seems_stale(found, timing) and observer.is_unchanged
                if not (observe and is_silent):
                    raise StoreBusyError(_busy_message(what, place, found, timing))
                if not is_reported:
                    is_reported = True
                    report_line(
                        f"{what}: {_holder(found)} seems to have stopped; waiting up to "
                        f"{timing.limit:.0f} s for a heartbeat"
                    )
            timing.pause(pause)
            pause = min(2 * pause, 0.5)


@dataclass
class _Observer:
    """How long a lease stays as it is, by the clock of this process.

    The time between two observations counts as one interval at most: a process that was suspended
    itself, perhaps together with the holder, has not observed anything meanwhile.
    """

    timing: Timing
    _last: Found | None = None
    _observed: float = 0.0
    _silent: float = 0.0
    is_unchanged: bool = True
    """Whether no change was observed since the first observation."""

    def is_stale(self, found: Found) -> bool:
        """Observe a lease: whether it was given back, its process has ended, or it is silent."""
        now = self.timing.clock()
        if found == self._last:
            self._silent += min(now - self._observed, self.timing.interval)
        else:
            self.is_unchanged = self._last is None
            self._last, self._silent = found, 0.0
        self._observed = now
        content = _decoded(found.content)
        return (
            found.content == RELEASED
            or (content is not None and process_identity.has_ended(content.holder))
            or self._silent >= self.timing.limit
        )


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
    """Whether its time is older than the limit, or unusable because clocks differ."""
    return not 0.0 <= time.time() - found.modified / 1e9 <= timing.limit


def _holder(found: Found) -> str:
    if found.content == RELEASED:
        return "another process, which has ended"
    return str(_decoded(found.content) or "an unknown process")


def _busy_message(what: str, place: LeasePlace, found: Found, timing: Timing) -> str:
    owner, _, name = what.rpartition(": ")
    message = f"{owner}: {_holder(found)} holds {name}; wait for it, or stop it"
    if _seems_stale(found, timing):
        return f"{message}; if it has ended without releasing the lock, remove {place.path}"
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
