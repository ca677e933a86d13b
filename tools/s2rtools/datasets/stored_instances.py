"""The instances of a trajectory whose frames have been stored, with the checksums of these."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from s2rtools.datasets.scan import FrameChecksum, InstanceRecord

_DIGEST = 32
"""Bytes of a SHA-256."""


class StoredTrajectory:
    """The stored ones of a trajectory's records, in recording order.

    An instance takes 4 bytes of memory, and 40 for each of its domains.
    """

    def __init__(self, records: Sequence[InstanceRecord]) -> None:
        self._records = records
        self._rows = array("i")
        self._digests: dict[str, bytearray] = {}
        self._valid_fractions: dict[str, array[float]] = {}

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[tuple[InstanceRecord, dict[str, FrameChecksum]]]:
        """The records and the checksums of their frames, by domain."""
        for position, row in enumerate(self._rows):
            checksums = {domain: self.checksum(domain, position) for domain in self._digests}
            yield self._records[row], checksums

    def records(self, start: int = 0, stop: int | None = None) -> list[InstanceRecord]:
        """The stored records of some positions."""
        return [self._records[row] for row in self._rows[start:stop]]

    @property
    def domains(self) -> list[str]:
        """The domains of the frames."""
        return list(self._digests)

    def row_numbers(self, start: int = 0) -> list[int]:
        """The numbers of the stored records from a position on."""
        return self._rows[start:].tolist()

    def headings(self) -> NDArray[np.float64]:
        """The headings of all instances, radians."""
        headings = (self._records[row].heading for row in self._rows)
        return np.fromiter(headings, np.float64, len(self))

    def checksum(self, domain: str, position: int) -> FrameChecksum:
        """The checksum of the frame of a domain at a position."""
        digest = self._digests[domain][_DIGEST * position : _DIGEST * (position + 1)]
        return FrameChecksum(digest.hex(), self._valid_fractions[domain][position])

    def add(self, row: int, checksums: Mapping[str, FrameChecksum]) -> None:
        """Add the record number `row` with the checksums of its frames by domain."""
        self._rows.append(row)
        for domain, frame in checksums.items():
            self._digests.setdefault(domain, bytearray()).extend(bytes.fromhex(frame.sha256))
            self._valid_fractions.setdefault(domain, array("d")).append(frame.valid_fraction)


StoredRecords = dict[str, StoredTrajectory]
