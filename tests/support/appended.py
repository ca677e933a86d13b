"""Append made-up trajectories to any store with poses."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import s2rstore
from s2rstore.records import Domain
from s2rtools.datasets.appending.append import append
from s2rtools.datasets.scan import DecodedFrame, InstanceRecord, Scan


@dataclass(frozen=True)
class MadeFrame:
    """A frame whose pixels depend on the seed alone."""

    size: tuple[int, int]
    seed: int

    @property
    def pixels(self) -> int:
        return self.size[0] * self.size[1]

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        return f"{self.seed}.png", f"{self.seed}_depth.png"

    def checksum(self, scan: Scan, domain: Domain) -> str:
        return self.decode(scan, domain).sha256

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame:
        rng = np.random.default_rng(self.seed)
        rgb = rng.integers(0, 256, (*self.size, 3), dtype=np.uint8)
        depth = rng.integers(0, 256, self.size, dtype=np.uint8)
        digest = hashlib.sha256(rgb.tobytes() + depth.tobytes()).hexdigest()
        return DecodedFrame(rgb, depth, digest, 1.0)


def append_trajectory(store: Path, name: str, count: int) -> None:
    """Append a trajectory along the diagonal of the bounds."""
    with s2rstore.open(store) as opened:
        dataset, domains = opened.dataset, dict(opened.domains)
    size, edges = (dataset.frame_height, dataset.frame_width), dataset.bounds
    scan = Scan(
        "made", Path(), size, dataset.y_down, edges, dataset.accuracy_scale, (), domains=domains
    )
    scan.trajectories[name] = [
        InstanceRecord(
            edges.x0 + share * (edges.x1 - edges.x0), edges.y0 + share * (edges.y1 - edges.y0),
            0.1 * row,
            {domain: MadeFrame(size, 100 * row + k) for k, domain in enumerate(domains)},
        )
        for row, share in enumerate(np.linspace(0.1, 0.9, count))
    ]  # fmt: skip
    append(scan, store, "s2r ingest", True, lambda steps: None)
