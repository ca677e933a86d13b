"""Copy the published generation of a store to object storage, so that others can read it there.

Files that never change go first, `CURRENT.json` last: readers see the old generation or the new.
`CURRENT.json` is replaced only in the version that was checked, where the server supports that.
An object is skipped where its size and checksum are those of the file, so that an interrupted copy
is resumed. Nothing is deleted. A lease keeps two pushes apart, because two stores may have
different files of one name, such as the index of the same generation.
"""

from __future__ import annotations

import hashlib
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Protocol

import msgspec

from s2rstore.errors import CheckFailedError, RequestError
from s2rstore.files import layout, safe_files
from s2rstore.files.ledger import LedgerEntry, generation_file
from s2rstore.files.store_files import LocalFiles
from s2rstore.maintenance.generation_files import GenerationFile, generation_files
from s2rstore.maintenance.push_lease import PushLease, push_lease
from s2rstore.reader import Store
from s2rstore.remote.object_client import ObjectClient
from s2rstore.remote.remote_files import RemoteFiles
from s2rstore.remote.store_url import StoreUrl

CHECKSUM = "sha256"
"""The value of an object that states the SHA-256 of its content."""

_THREADS = 8
_WAITING = 64
"""Files that are compared or sent, or wait for it, at a time."""
_AT_ONCE_BYTES = 16 * 2**20
"""Files up to this size are read once, to be compared and sent."""
_CHANGING = {"Cache-Control": "no-cache"}
"""A cache must ask whether its copy is the present one."""
_FIXED = {"Cache-Control": "max-age=31536000, immutable"}
"""For objects that are named by their content. Another store has other content of the same name."""
_HASH_DIGITS = 16
"""The least digits of a checksum that name a file, such as those of rows."""


class Progress(Protocol):
    """Receives the number of files, how many were dealt with, and messages."""

    def begin(self, stage: str, total: int) -> None: ...
    def advance(self, steps: int) -> None: ...
    def say(self, line: str) -> None: ...


@dataclass(frozen=True, slots=True)
class PushResult:
    """The generation, how many objects and bytes were sent, and how many objects were there."""

    generation: int
    sent: int
    bytes: int
    skipped: int


def push(root: Path, url: StoreUrl, progress: Progress, force: bool = False) -> PushResult:
    """Copy the published generation of the store in the folder `root` to a URL.

    With `force` a newer generation, or another data set, that is published there is replaced.
    Raises RequestError where that is refused, StoreBusyError while another process pushes there,
    CheckFailedError where a file of the store is not as published, UnreachableStoreError where the
    server does not take a file.
    """
    if url.scheme != "s3":
        raise RequestError(f"{url}: push needs a URL that begins with s3://")
    current = layout.read_current(root)
    there = RemoteFiles(url)
    if not force:
        _refuse_replacing(root, current, there)
    client = ObjectClient(url)
    with push_lease(client, progress.say) as lease:
        return _push(root, current, there, client, progress, force, lease)


def _push(
    root: Path,
    current: layout.Current,
    there: RemoteFiles,
    client: ObjectClient,
    progress: Progress,
    force: bool,
    lease: PushLease,
) -> PushResult:
    """See `push`; the lease of the target is held."""
    if not force:  # another push may have ended since the first check
        _refuse_replacing(root, current, there)
    with Store(root) as store:
        if store.generation != current.generation:
            raise RequestError(f"{root}: a generation was published meanwhile; run it again")
        files = generation_files(store, current)
        history = store.files.stamp(layout.GAP_HISTORY) is not None
    progress.begin("push", len(files) + 2 + history)
    transfer = _Transfer(LocalFiles(root), client, progress, lease)
    transfer.send_all(files)
    transfer.send_content(generation_file(current.generation), transfer.ledger())
    if history:
        content = safe_files.read(root, layout.GAP_HISTORY)
        transfer.send_content(layout.GAP_HISTORY, content)
    content = safe_files.read(root, layout.CURRENT)
    if msgspec.json.decode(content, type=layout.Current) != current:
        content = msgspec.json.encode(current)
    if force:
        transfer.send_content(layout.CURRENT, content)
    else:
        etag = _version(client)
        _refuse_replacing(root, current, there)
        transfer.publish(content, etag)
    return PushResult(current.generation, transfer.sent, transfer.bytes, transfer.skipped)


def _version(client: ObjectClient) -> str | None:
    """The ETag of the published state of the target; None where it has none."""
    with suppress(FileNotFoundError):
        return client.head(layout.CURRENT).etag
    return None


def _refuse_replacing(root: Path, current: layout.Current, there: RemoteFiles) -> None:
    """Raise RequestError where the published state of the target must not be replaced."""
    if there.kind(layout.CURRENT) is None:
        return
    published = layout.current_of(there)
    told = "; --force replaces it"
    if published.dataset_hash != current.dataset_hash:
        with Store(there) as other, Store(root) as store:
            if other.identity != store.identity:
                name = other.dataset.name
                raise RequestError(f"{there.path}: holds another data set ({name}){told}")
    if published.generation > current.generation:
        raise RequestError(
            f"{there.path}: generation {published.generation} is newer than that of {root}, "
            f"{current.generation}{told}"
        )
    if published.generation == current.generation and published.sha256 != current.sha256:
        raise RequestError(
            f"{there.path}: generation {published.generation} is not that of {root}: both were "
            f"changed independently{told}"
        )


class _Transfer:
    """Sends files that are not there, several at a time, and counts them."""

    def __init__(
        self, files: LocalFiles, client: ObjectClient, progress: Progress, lease: PushLease
    ) -> None:
        self._files, self._client, self._progress, self._lease = files, client, progress, lease
        self._entries: list[LedgerEntry] = []
        self.sent = self.bytes = self.skipped = 0

    def send_all(self, files: list[GenerationFile]) -> None:
        """Compare all files with their objects and send what differs; the first error ends it."""
        waiting: set[Future[tuple[LedgerEntry, bool]]] = set()
        remaining = iter(files)
        with ThreadPoolExecutor(_THREADS, "push") as pool:
            try:
                while True:
                    for file in islice(remaining, _WAITING - len(waiting)):
                        waiting.add(pool.submit(self._send, file))
                    if not waiting:
                        return
                    done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
                    for future in done:
                        entry, was_sent = future.result()
                        self._entries.append(entry)
                        self._count(entry.bytes, was_sent)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise

    def ledger(self) -> bytes:
        """The lines of all files that are there, by path."""
        entries = sorted(self._entries, key=lambda entry: entry.path)
        return b"".join(msgspec.json.encode(entry) + b"\n" for entry in entries)

    def publish(self, content: bytes, etag: str | None) -> None:
        """Send `CURRENT.json` in place of its version `etag`, unless it is there.

        Raises RequestError where another push has replaced that version.
        """
        name, sha256 = layout.CURRENT, hashlib.sha256(content).hexdigest()
        known = len(content), sha256, _md5(content)
        self._lease.check()
        is_there = self._is_there(name, *known)
        if not (
            is_there
            or self._client.put_unless_changed(name, content, _attributes(name, sha256), etag)
            # A repeated request finds the object of the first one, whose answer was lost.
            or self._is_there(name, *known)
        ):
            where = self._client.url
            raise RequestError(f"{where}: another push published meanwhile; run it again")
        self._count(len(content), not is_there)

    def send_content(self, name: str, content: bytes) -> None:
        """Send a small file whose content is known, unless it is there."""
        sha256 = hashlib.sha256(content).hexdigest()
        is_there = self._is_there(name, len(content), sha256, _md5(content))
        if not is_there:
            self._lease.check()
            self._client.put(name, content, _attributes(name, sha256))
        self._count(len(content), not is_there)

    def _count(self, size: int, was_sent: bool) -> None:
        self.sent += was_sent
        self.skipped += not was_sent
        self.bytes += size * was_sent
        self._progress.advance(1)

    def _send(self, file: GenerationFile) -> tuple[LedgerEntry, bool]:
        """Send a file unless it is there; runs in a thread."""
        content: bytes | Path
        if file.bytes <= _AT_ONCE_BYTES:
            content = safe_files.read(self._files.path, file.path)
            sha256, md5 = hashlib.sha256(content).hexdigest(), _md5(content)
        else:
            content = safe_files.checked_path(self._files.path, file.path)
            sha256, md5 = self._files.sha256(file.path), ""
        unknown = LedgerEntry("push", file.path, file.bytes, sha256, 1)
        proofs = (proof for proof in file.proofs or [unknown] if proof.checksum == sha256)
        entry = next(proofs, None)
        if entry is None:
            where = self._files.path / file.path
            raise CheckFailedError(f"{where}: not as published; run `s2r verify`")
        if self._is_there(file.path, file.bytes, sha256, md5):
            return entry, False
        self._lease.check_at_times()
        self._client.put(file.path, content, _attributes(file.path, sha256))
        return entry, True

    def _is_there(self, name: str, size: int, sha256: str, md5: str) -> bool:
        """Whether the object of a file has its size and its SHA-256, or else its MD5."""
        with suppress(FileNotFoundError):
            facts, attributes = self._client.attributes(name)
            if facts.bytes == size:
                stated = attributes.get(CHECKSUM)
                return stated == sha256 if stated else bool(md5) and facts.etag.strip('"') == md5
        return False


def _attributes(name: str, sha256: str) -> dict[str, str]:
    """The values of an object: the SHA-256 of its content, and how long a cache may keep it."""
    stem = name.rsplit("/", 1)[-1].split(".")[0]
    is_named_by_content = len(stem) >= _HASH_DIGITS and sha256.startswith(stem)
    return {CHECKSUM: sha256, **(_FIXED if is_named_by_content else _CHANGING)}


def _md5(content: bytes) -> str:
    return hashlib.md5(content, usedforsecurity=False).hexdigest()
