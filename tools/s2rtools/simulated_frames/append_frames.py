"""Append the frames of a folder to a store, as instances of the sim side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import s2rstore
from s2rtools.datasets.command import append_scan, print_issues
from s2rtools.datasets.floor.floor_poses import FloorOptions
from s2rtools.datasets.layouts import read
from s2rtools.datasets.pairing.one_recording import scan_recording
from s2rtools.datasets.pairing.paired_recordings import MapOptions
from s2rtools.datasets.pairing.stored_worlds import stored_worlds
from s2rtools.simulated_frames.command import SIDE
from s2rtools.simulated_frames.frame_folder import TABLE


def append_frames(folder: Path, target: Path) -> int:
    """Append what a folder of frames has and a store does not have; return the exit code.

    Poses are those of the map. Raises RequestError where cameras or frames do not agree with the
    store.
    """
    recording = read("csv", folder / TABLE)
    with s2rstore.open(target) as store:
        worlds = replace(stored_worlds(store, ()), floors={}, alignment=None)
        frame = store.dataset.frame_height, store.dataset.frame_width
        domain = store.domains.get(SIDE)
    made = scan_recording(
        recording, SIDE, FloorOptions(ground=0.0), MapOptions(frame, stored=worlds), domain
    )
    if domain is not None:  # its camera and range of depth are those that the frames were made for
        made.scan.domains = {SIDE: domain}
    try:
        return append_scan(made.scan, target, strict=False)
    finally:
        print_issues(made.scan.issues, False)
