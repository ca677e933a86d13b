"""Faults of a recording that has not been ingested."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from s2rtools.common.command_line.progress import Reporter
from s2rtools.common.input_issue import InputIssue
from s2rtools.data_health.faults import Fault, Recorded, faults
from s2rtools.data_health.measures import ImageMeasures
from s2rtools.datasets.recording import Recording


def recording_faults(recording: Recording, progress: Reporter) -> list[Fault]:
    """The faults of a recording's images, poses and times, under its name as domain.

    Images count through all trajectories in their order, see `image_names`. Images that cannot be
    read have no faults.
    """
    parts = list(recording.trajectories.values())
    count = sum(len(part.frames) for part in parts)
    measures, number = ImageMeasures.empty(count), 0
    progress.begin(f"images of {recording.name}", count)
    for part in parts:
        previous = None
        for frame in part.frames:
            rgb = frame.rgb.read()
            depth = None if frame.depth is None else frame.depth.read()
            if isinstance(rgb, InputIssue):
                previous = None
            else:
                previous = measures.measure(number, rgb.pixels, previous)
            if depth is not None and not isinstance(depth, InputIssue):
                measures.measure_depth(number, depth.pixels, 1, recording.depth_raw_max)
            number += 1
            progress.advance(1)
    codes = np.repeat(np.arange(len(parts)), [len(part.frames) for part in parts])
    poses = np.concatenate([part.poses for part in parts])
    times = np.concatenate([part.timestamps for part in parts])
    recorded = Recorded(measures, on_floor(poses, recording.up), times, codes)
    return list(faults(recorded, recording.name))


def image_names(recording: Recording) -> list[str]:
    """Names of the RGB images, in the order of their numbers."""
    parts = recording.trajectories.values()
    return [part.frames[row].rgb.name for part in parts for row in range(len(part.frames))]


def on_floor(
    poses: NDArray[np.float64], up: tuple[float, float, float] | None
) -> NDArray[np.float64]:
    """Positions and headings (N, 3) of camera poses (N, 4, 4) in a plane across `up`.

    Where that is not known, it is the mean of what is up in the images.
    """
    upwards = np.array(up) if up is not None else -poses[:, :3, 1].mean(axis=0)
    upwards = upwards / max(np.linalg.norm(upwards), 1e-9)
    least = np.eye(3)[int(np.argmin(np.abs(upwards)))]
    first = np.cross(least, upwards)
    first /= np.linalg.norm(first)
    second = np.cross(upwards, first)
    place, forward = poses[:, :3, 3], poses[:, :3, 2]
    headings = np.arctan2(forward @ second, forward @ first)
    return np.column_stack([place @ first, place @ second, headings])
