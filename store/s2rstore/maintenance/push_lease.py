"""The lease on the target of a push: two pushes never send files of one name at once.

The lease is an object (`s2rstore.files.lease`). All writes are conditional on the version that was
read, so that one process holds it. A released lease stays as an object, because users who may write
objects may not always delete them.

What remains are the requests that a process has sent, or is about to send, when it is suspended for
longer than the limit. A server that ignores conditions does not keep apart two pushes that begin
within the same moment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from s2rstore.errors import S2RError
from s2rstore.files import layout, lease
from s2rstore.files.lease import Found, Lease, Timing
from s2rstore.remote.object_client import ObjectClient
from s2rstore.remote.store_url import StoreUrl

NAME = f"{layout.LEDGER}/push.lock"
TIMING = Timing(interval=10.0)
_ATTRIBUTES = {"Cache-Control": "no-cache"}


class LockObject:
    """A `LeasePlace` in the target of a push."""

    def __init__(self, client: ObjectClient) -> None:
        self._client = client

    @property
    def path(self) -> StoreUrl:
        return self._client.url / NAME

    def read(self) -> Found | None:
        """See `LeasePlace`."""
        try:
            content, facts = self._client.whole(NAME, lease.SIZE)
        except FileNotFoundError:
            return None
        return Found(content, facts.modified_ns, facts.etag)

    def swap(self, found: Found | None, content: bytes | None) -> bool:
        """See `LeasePlace`; `lease.RELEASED` is written for no content."""
        written, version = content or lease.RELEASED, None if found is None else found.version
        self._client.put_unless_changed(NAME, written, _ATTRIBUTES, version)
        # Whether it was written says nothing: a server may ignore the condition, and a request that
        # is repeated finds the object of the first one.
        present = self.read()
        return present is not None and present.content == written

    def renew(self, is_own: Callable[[bytes], bool], content: bytes) -> bool:
        """See `LeasePlace`."""
        found = self.read()
        return found is not None and is_own(found.content) and self.swap(found, content)


@contextmanager
def push_lease(client: ObjectClient, report_line: Callable[[str], None]) -> Iterator[Lease]:
    """Hold the lease of a target. Raises StoreBusyError where another process pushes there.

    A process whose last heartbeat seems to be old is observed for the limit of `TIMING`, and
    `report_line` gets a line that says so.
    """
    what = f"{client.url}: the push lock"
    held = lease.acquire(LockObject(client), what, 0.0, TIMING, True, report_line)
    try:
        yield held
    finally:
        with suppress(S2RError, OSError):
            held.release()
