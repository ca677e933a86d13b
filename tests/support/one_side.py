"""Instances of one side, appended to any store: poses and images of its first instances."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import s2rstore
from s2rstore.reader import Store
from s2rtools.datasets.appending.append import append
from s2rtools.datasets.scan import DecodedFrame, InstanceRecord, Scan


@dataclass(frozen=True, slots=True)
class StoredFrame:
    """A frame of a store as the source of another instance."""

    store: Store
    domain: str
    iid: int
    number: int
    pixels: int = 1

    def file_names(self, scan: Scan) -> tuple[str, None]:
        return f"{self.domain}-{self.number}.png", None

    def checksum(self, scan: Scan, domain: object) -> str:
        return hashlib.sha256(f"{self.domain} {self.number}".encode()).hexdigest()

    def decode(self, scan: Scan, domain: object) -> DecodedFrame:
        frame = self.store.frame(self.domain, self.iid)
        share = float(frame.valid.mean())
        return DecodedFrame(frame.rgb, frame.depth, self.checksum(scan, domain), share)


def append_side(path: Path, domain: str, count: int, trajectory: str) -> None:
    """Append a trajectory of `count` instances that have images in one domain alone."""
    with s2rstore.open(path) as store:
        truth, data = store.instances, store.dataset
        records = []
        for number in range(count):
            iid = number % len(truth)
            pose = (float(column[iid]) for column in (truth.x, truth.y, truth.heading))
            records.append(InstanceRecord(*pose, {domain: StoredFrame(store, domain, iid, number)}))
        scan = Scan(
            data.name, path, (data.frame_height, data.frame_width), data.y_down, data.bounds,
            data.accuracy_scale, store.rooms, {domain: store.domains[domain]},
            trajectories={trajectory: records}, has_default_scale=True,
        )  # fmt: skip
        append(scan, path, "s2r ingest", True, lambda frames: None)
