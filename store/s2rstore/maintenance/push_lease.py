"""A lease on the target of a push: two pushes never send files of one name at once.

The lease is an object that states its holder, and that a thread of the holder writes again every
few seconds. All writes are conditional on the version that was read, so that one process holds it.
A lease is stale when its process has certainly ended, or when its object has not changed while it
was observed for `Timing.limit` seconds; clocks of two machines are not compared to decide that.
Released leases stay as objects, because users who may write objects may not always delete them.

What remains are the requests that a process has sent, or is about to send, when it is suspended for
longer than the limit. A server that ignores conditions does not keep apart two pushes that begin
within the same moment.
"""

from __future__ import annotations

import datetime
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Annotated

import msgspec

from s2rstore.errors import S2RError, StoreBusyError
from s2rstore.files import layout, process_identity
from s2rstore.files.process_identity import ProcessIdentity
from s2rstore.remote.object_client import ObjectClient, ObjectFacts

NAME = f"{layout.LEDGER}/push.lock"
_LARGEST = 4096
_ATTRIBUTES = {"Cache-Control": "no-cache"}


@dataclass(frozen=True, slots=True)
class Timing:
    """Seconds between two heartbeats, and seconds without one that make a lease stale."""

    interval: float = 10.0
    limit: float = 60.0


TIMING = Timing()


class _Content(msgspec.Struct, frozen=True):
    """The content of the object, as JSON; `since` is by the clock of the holder."""

    lease: Annotated[str, msgspec.Meta(pattern=r"\A[0-9a-f]{32}\Z")]
    holder: ProcessIdentity
    since: Annotated[str, msgspec.Meta(max_length=40)]
    beats: Annotated[int, msgspec.Meta(ge=0, le=2**62)] = 0
    released: bool = False


@dataclass(frozen=True, slots=True)
class _Found:
    """What a target has in the place of a lease; `content` is None where it cannot be read."""

    content: _Content | None
    facts: ObjectFacts

    def __str__(self) -> str:
        if self.content is None:
            return "an unknown process"
        return f"{self.content.holder} (since {self.content.since})"

    @property
    def is_free(self) -> bool:
        """Whether its push has released it, or has certainly ended."""
        content = self.content
        return content is not None and (
            content.released or process_identity.has_ended(content.holder)
        )

    def has(self, content: _Content) -> bool:
        """Whether it is the lease of some content."""
        return self.content is not None and self.content.lease == content.lease

    def seems_alive(self, limit: float) -> bool:
        """Whether its last heartbeat is recent, if the clocks of server and client agree."""
        return 0.0 <= time.time() - self.facts.modified_ns / 1e9 <= limit


class PushLease:
    """A lease that this process holds."""

    def __init__(self, client: ObjectClient, content: _Content, timing: Timing) -> None:
        self._client, self._content, self._timing = client, content, timing
        self._renewed = time.monotonic()
        self._loss = ""
        self._mutex = threading.Lock()
        self._released = threading.Event()
        threading.Thread(target=self._beat, name="heartbeat of the push", daemon=True).start()

    def check(self) -> None:
        """Renew the lease. Raises StoreBusyError where another push has taken it over."""
        with self._mutex:
            self._renew()
        if self._loss:
            raise StoreBusyError(
                f"{self._client.url}: {self._loss} has begun to push there; this push was "
                "suspended, or had no connection: run it again when the other has ended"
            )

    def check_at_times(self) -> None:
        """As `check`, but without a request where the last heartbeat is recent."""
        if self._loss or time.monotonic() > self._renewed + self._timing.limit / 2:
            self.check()

    def release(self) -> None:
        """Give the lease back; one that another push has taken over stays its own."""
        self._released.set()
        with self._mutex, suppress(S2RError, OSError):
            self._renew(released=True)

    def _beat(self) -> None:
        while not self._loss and not self._released.wait(self._timing.interval):
            with self._mutex, suppress(S2RError, OSError):  # the next heartbeat tries again
                if not self._released.is_set():
                    self._renew()

    def _renew(self, released: bool = False) -> None:
        """Write the lease again if it is still the own one, else note who has it."""
        if self._loss:
            return
        content = msgspec.structs.replace(
            self._content, beats=self._content.beats + 1, released=released
        )
        found = _read(self._client)
        if found is not None and found.has(self._content) and _write(self._client, content, found):
            self._content, self._renewed = content, time.monotonic()
        else:
            self._loss = str(_read(self._client) or "another process")


@contextmanager
def push_lease(client: ObjectClient, report_line: Callable[[str], None]) -> Iterator[PushLease]:
    """Hold the lease of a target. Raises StoreBusyError where another process pushes there.

    A process whose last heartbeat seems to be old is observed for the limit of `TIMING`, and
    `report_line` gets a line that says so.
    """
    timing = TIMING
    content = _Content(uuid.uuid4().hex, process_identity.this_process(), _now())
    _take(client, content, report_line, timing)
    lease = PushLease(client, content, timing)
    try:
        yield lease
    finally:
        lease.release()


def _take(
    client: ObjectClient, content: _Content, report_line: Callable[[str], None], timing: Timing
) -> None:
    """Write the lease where it is free or stale."""
    first, since = _read(client), time.monotonic()
    if first is not None and not first.is_free:
        if first.seems_alive(timing.limit):
            raise _busy(client, first)
        report_line(
            f"{client.url}: {first} seems to have stopped pushing; waiting {timing.limit:.0f} s "
            "for a heartbeat"
        )
    found = first
    while found is not None and not found.is_free:
        if first is None or found.facts.etag != first.facts.etag or found.content != first.content:
            raise _busy(client, found)
        if time.monotonic() > since + timing.limit:
            break
        time.sleep(timing.interval / 4)
        found = _read(client)
    if not _write(client, content, found):
        raise _busy(client, _read(client))


def _busy(client: ObjectClient, found: _Found | None) -> StoreBusyError:
    who = found or "another process"
    return StoreBusyError(f"{client.url}: {who} pushes there; wait for it, or stop it")


def _write(client: ObjectClient, content: _Content, found: _Found | None) -> bool:
    """Write a lease in the place of the one that was found; False where another one is there."""
    etag = None if found is None else found.facts.etag
    client.put_unless_changed(NAME, msgspec.json.encode(content), _ATTRIBUTES, etag)
    # Whether it was written says nothing: a server may ignore the condition, and a request that is
    # repeated finds the object of the first one.
    present = _read(client)
    return present is not None and present.has(content)


def _read(client: ObjectClient) -> _Found | None:
    try:
        text, facts = client.whole(NAME, _LARGEST)
    except FileNotFoundError:
        return None
    try:
        return _Found(msgspec.json.decode(text, type=_Content), facts)
    except (msgspec.DecodeError, ValueError):
        return _Found(None, facts)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
