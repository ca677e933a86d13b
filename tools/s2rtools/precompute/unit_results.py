"""Results of work units: one file per unit, until the shards that need it are complete.

A file holds the compressed chunks of the unit's arrays, so that a shard is made by joining them. It
is a line of JSON with their sizes and the SHA-256 of the rest, then the chunks. Files are not
flushed to the disk: one that a power failure damaged does not have its checksum and is computed
again.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, chain
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from s2rstore.arrays.stored_array import codec
from s2rstore.errors import RequestError
from s2rstore.files import atomic_writes, layout, safe_files
from s2rtools.precompute.work_units import Stage, WorkUnit

_HEADER_BYTES = 16 * 2**20
_BLOCK, _LINE_BLOCK = 2**20, 2**14

_Size = Annotated[int, msgspec.Meta(ge=0, le=2**40)]


class _Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Sizes of the chunks of each array, given by its path, and the checksum of all chunks."""

    chunks: dict[str, list[_Size]]
    sha256: str


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


def write(root: Path, unit: WorkUnit, chunks: Mapping[str, list[bytes]]) -> None:
    """Write the compressed chunks of a unit's arrays, given by their paths in runs.zarr."""
    digest = hashlib.sha256()
    for chunk in chain.from_iterable(chunks.values()):
        digest.update(chunk)
    sizes = {path: list(map(len, parts)) for path, parts in chunks.items()}
    header = msgspec.json.encode(_Header(sizes, digest.hexdigest())) + b"\n"
    content = iter([header, *chain.from_iterable(chunks.values())])
    atomic_writes.write(root, file_name(unit.stage, unit.number), content, durable=False)


@dataclass(frozen=True, slots=True)
class UnitResult:
    """A complete result; `places` are the first byte and the sizes of each array's chunks."""

    file: Path
    places: Mapping[str, tuple[int, list[int]]]

    def chunks(self, path: str, folder: int) -> Iterator[bytes]:
        """The compressed chunks of an array. Raises RequestError where the file has changed.

        `folder` is a descriptor of the folder of the stage's results.
        """
        offset, sizes = self.places[path]
        descriptor = safe_files.open_regular_at(self.file, os.O_RDONLY, folder)
        with open(descriptor, "rb", buffering=0) as file:
            file.seek(offset)
            for size in sizes:
                chunk = file.read(size)
                if len(chunk) != size:
                    raise RequestError(f"{self.file}: cut; run the command again")
                yield chunk


def read(root: Path, name: str, is_checked: bool = True) -> UnitResult | None:
    """Open a result; None where there is none, or where it is damaged.

    The checksum is compared if `is_checked`; without that the process must have written it.
    """
    try:
        with safe_files.open_read(root, name) as file:
            content = file.read(_LINE_BLOCK)
            while b"\n" not in content and len(content) < _HEADER_BYTES:
                more = file.read(_LINE_BLOCK)
                if not more:
                    return None
                content += more
            line, _, rest = content.partition(b"\n")
            header = msgspec.json.decode(line, type=_Header)
            total = sum(map(sum, header.chunks.values()))
            if os.fstat(file.fileno()).st_size != len(line) + 1 + total:
                return None
            if is_checked:
                digest = hashlib.sha256(rest)
                while block := file.read(_BLOCK):
                    digest.update(block)
                if digest.hexdigest() != header.sha256:
                    return None
    except (FileNotFoundError, msgspec.DecodeError):
        return None
    starts = accumulate(map(sum, header.chunks.values()), initial=len(line) + 1)
    places = zip(header.chunks, zip(starts, header.chunks.values(), strict=False), strict=True)
    return UnitResult(root / name, dict(places))
