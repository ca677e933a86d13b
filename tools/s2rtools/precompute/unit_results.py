"""Results of work units: one file per unit, until the shards that need it are complete.

A file holds the compressed chunks of the unit's arrays, so that a shard is made by joining them. It
is a line of JSON with the instances of the unit, what computed them, the sizes of the chunks and
the SHA-256 of the rest, then the chunks.

A worker writes its result under a unique name and states it in a receipt; the process that runs the
workers accepts it, which gives the file its final name. So a unit may be computed by two workers at
once, one of which seemed to be lost. Files of workers of the same host are not flushed to the disk:
one that a power failure damaged does not have its checksum and is computed again.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from itertools import accumulate, chain
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays.stored_array import BLOSC_HEADER, check_chunk, codec
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rstore.files.compute_environment import ComputeEnvironment
from s2rtools.precompute.work_units import Stage, WorkUnit


class Receipt(msgspec.Struct, frozen=True):
    """A unit whose result was written under a unique name and is not used yet.

    `unit` is the file that the result shall become, `path` the one that was written, both inside
    the store. `sha256` is that of the result's chunks, as its header states it, `bytes` the size of
    the whole file. `seconds` were taken on `host`, in `environment`: its device, precision, threads
    and versions of libraries.
    """

    unit: str
    path: str
    bytes: int
    sha256: str
    seconds: float
    host: str
    environment: ComputeEnvironment


VISIBLE_SECONDS = 90.0
"""How long a result of another host is waited for; NFS caches folders for 60 s by default."""
_HEADER_BYTES = 16 * 2**20
_BLOCK, _LINE_BLOCK = 2**20, 2**14

_Size = Annotated[int, msgspec.Meta(ge=0, le=2**32)]


class _Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """First and number of instances, the compressed sizes of each array's chunks by its path."""

    version: Literal[2]
    first_iid: int
    instances: int
    environment: ComputeEnvironment
    chunks: dict[str, list[_Size]]
    sha256: str


@dataclass(frozen=True, slots=True)
class ChunkSizes:
    """How many chunks a unit has of an array, and the bytes of one that is not compressed."""

    count: int
    bytes: int


def folder(stage: Stage) -> str:
    """The folder of a stage's results inside the store."""
    name = stage.name.replace(":", ".")
    return f"{layout.UNITS}/{stage.run}/{stage.specs[0].key}.{name}.{stage.first_iid}"


def file_name(stage: Stage, number: int) -> str:
    """The file of a unit's result inside the store."""
    return f"{folder(stage)}/{number}"


def encode_totals(totals: NDArray[np.float64]) -> list[bytes]:
    """Compress the totals (n, *item) of a unit of a stage of aggregates as one chunk."""
    return [bytes(codec("float64").encode(np.ascontiguousarray(totals)))]


def decode_totals(chunks: Sequence[bytes], item: tuple[int, ...]) -> NDArray[np.float64]:
    """The totals (n, *item) of `encode_totals`."""
    (chunk,) = chunks
    content: bytes = codec("float64").decode(chunk)
    return np.frombuffer(content, dtype=np.float64).reshape(-1, *item)


def write_attempt(
    root: Path,
    unit: WorkUnit,
    chunks: Mapping[str, list[bytes]],
    environment: ComputeEnvironment,
    durable: bool = False,
) -> tuple[str, int, str]:
    """Write the compressed chunks of a unit's arrays, given by their paths in runs.zarr.

    Returns path, size and checksum for the receipt. With `durable` the file is on the disk, where
    other hosts read it. Raises FileNotFoundError where nothing waits for results of the stage.
    """
    digest = hashlib.sha256()
    for chunk in chain.from_iterable(chunks.values()):
        digest.update(chunk)
    sizes = {path: list(map(len, parts)) for path, parts in chunks.items()}
    rows = unit.instances
    header = _Header(2, rows.start, len(rows), environment, sizes, digest.hexdigest())
    line = msgspec.json.encode(header) + b"\n"
    content = iter([line, *chain.from_iterable(chunks.values())])
    name = file_name(unit.stage, unit.number)
    path = atomic_writes.write_attempt(root, name, content, durable)
    return path, len(line) + sum(map(sum, sizes.values())), header.sha256


def accept(root: Path, unit: WorkUnit, receipt: Receipt) -> None:
    """Give a result that a worker wrote its final name.

    Another host may see the file later than it was written, for as long as file systems cache.
    Raises RequestError where it does not appear, or is not what the receipt states.
    """
    name = file_name(unit.stage, unit.number)
    if receipt.unit != name or Path(receipt.path).parent != Path(name).parent:
        raise RequestError(f"{root / receipt.path}: not a result of {name}; run the command again")
    deadline = time.monotonic() + VISIBLE_SECONDS
    while (size := _size(root, receipt.path)) != receipt.bytes:
        if time.monotonic() >= deadline:
            found = "is not there" if size is None else f"has {size} bytes, not {receipt.bytes}"
            raise RequestError(
                f"{root / receipt.path}: {found}; {receipt.host} must write to the same folder as "
                "this machine reads"
            )
        time.sleep(0.1)
    try:
        atomic_writes.rename(root, receipt.path, name, durable=False)
    except FileNotFoundError:
        # NFS repeats a request whose reply was lost, and finds the file renamed already.
        if _size(root, name) != receipt.bytes:
            raise


def _size(root: Path, path: str) -> int | None:
    try:
        return safe_files.size(root, path)
    except FileNotFoundError:
        return None


@dataclass(frozen=True, slots=True)
class UnitResult:
    """A complete result; `places` are the first byte and the sizes of each array's chunks.

    `sha256` is that of all chunks, `environment` what computed them.
    """

    file: Path
    places: Mapping[str, tuple[int, list[int]]]
    sha256: str
    environment: ComputeEnvironment

    def chunks(self, path: str, folder: int) -> Iterator[bytes]:
        """The compressed chunks of an array. Raises RequestError where the file has changed.

        `folder` is a descriptor of the folder of the stage's results.
        """
        offset, sizes = self.places[path]
        try:
            descriptor = safe_files.open_regular_at(self.file, os.O_RDONLY, folder)
        except FileNotFoundError as error:
            raise RequestError(f"{self.file}: removed meanwhile; run the command again") from error
        try:
            for size in sizes:
                chunk = os.pread(descriptor, size, offset)
                if len(chunk) != size:
                    raise RequestError(f"{self.file}: cut; run the command again")
                yield chunk
                offset += size
        finally:
            os.close(descriptor)


def read(
    root: Path, unit: WorkUnit, expected: Mapping[str, ChunkSizes], is_checked: bool = True
) -> UnitResult | None:
    """Open the result of a unit; None where there is none that holds the `expected` arrays.

    None also where it is damaged, or of other instances. If `is_checked`, the checksum and the
    header of each expected chunk are compared; without that this program must have written it.
    """
    name, rows = file_name(unit.stage, unit.number), unit.instances
    try:
        with safe_files.open_read(root, name) as file:
            line = _first_line(file)
            header = msgspec.json.decode(line, type=_Header)
            size = len(line) + sum(map(sum, header.chunks.values()))
            fits = (header.first_iid, header.instances) == (rows.start, len(rows))
            fits = fits and all(_has(header, *item) for item in expected.items())
            if not fits or os.fstat(file.fileno()).st_size != size:
                return None
            if is_checked and not _is_intact(file, len(line), header, expected):
                return None
    except (FileNotFoundError, msgspec.DecodeError):
        return None
    starts = accumulate(map(sum, header.chunks.values()), initial=len(line))
    places = zip(header.chunks, zip(starts, header.chunks.values(), strict=False), strict=True)
    return UnitResult(root / name, dict(places), header.sha256, header.environment)


def _first_line(file: FileIO) -> bytes:
    """The first line with its end; of a file without one, the first bytes."""
    content = b""
    while b"\n" not in content and len(content) < _HEADER_BYTES:
        more = file.read(_LINE_BLOCK)
        if not more:
            break
        content += more
    return content[: content.find(b"\n") + 1]


def _has(header: _Header, path: str, expected: ChunkSizes) -> bool:
    sizes = header.chunks.get(path)
    if sizes is None or len(sizes) != expected.count:
        return False
    return all(size <= expected.bytes + BLOSC_HEADER for size in sizes)


def _is_intact(
    file: FileIO, start: int, header: _Header, expected: Mapping[str, ChunkSizes]
) -> bool:
    """Whether the bytes from `start` on have their checksum, and expected chunks their header."""
    digest = hashlib.sha256()
    file.seek(start)
    while block := file.read(_BLOCK):
        digest.update(block)
    if digest.hexdigest() != header.sha256:
        return False
    for path, sizes in header.chunks.items():
        for size in sizes:
            if path in expected:
                head = os.pread(file.fileno(), min(size, BLOSC_HEADER), start)
                try:
                    check_chunk(head, size, expected[path].bytes, Path(str(file.name)))
                except RequestError:
                    return False
            start += size
    return True
