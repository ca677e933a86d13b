"""Append the frames of a folder to a store, as instances of the sim side."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import s2rstore
from s2rstore.lazy_sequence import LazySequence
from s2rstore.records import Domain
from s2rtools.datasets.command import append_scan, print_issues
from s2rtools.datasets.floor.floor_poses import FloorOptions
from s2rtools.datasets.layouts import read
from s2rtools.datasets.pairing.recorded_scan import MapOptions, scan_recording
from s2rtools.datasets.pairing.stored_worlds import stored_worlds
from s2rtools.datasets.scan import InstanceRecord
from s2rtools.simulated_frames.command import SIDE
from s2rtools.simulated_frames.frame_folder import TABLE


def append_frames(folder: Path, target: Path, domain: Domain) -> int:
    """Append what a folder of frames has and a store does not have; return the exit code.

    `domain` is that whose cameras the frames were rendered for. Raises RequestError where the
    frames do not agree with the store.
    """
    recording = read("csv", folder / TABLE)
    with s2rstore.open(target) as store:
        worlds = replace(
            stored_worlds(store, ()), floors={}, alignment=None,
            with_depth=frozenset((SIDE,) if domain.has_depth else ()),
        )  # fmt: skip
        frame = store.dataset.frame_height, store.dataset.frame_width
    rendered = replace(domain, domain=SIDE, kind=SIDE)
    made = scan_recording(
        recording, SIDE, FloorOptions(ground=0.0), MapOptions(frame, stored=worlds), rendered
    )
    made.scan.domains = {SIDE: rendered}
    for name, records in made.scan.trajectories.items():
        made.scan.trajectories[name] = _at_robots(records, domain.forward_offset)
    try:
        return append_scan(made.scan, target, strict=False)
    finally:
        print_issues(made.scan.issues, False)


def _at_robots(
    records: Sequence[InstanceRecord], forward_offset: float
) -> LazySequence[InstanceRecord]:
    """The records with the poses of robots in place of those of their cameras."""

    def record(row: int) -> InstanceRecord:
        each = records[row]
        return replace(
            each,
            x=each.x - forward_offset * math.cos(each.heading),
            y=each.y - forward_offset * math.sin(each.heading),
            frame_poses={},
        )

    return LazySequence(len(records), record)
