"""A video with the poses of its camera: MP4, MKV, WebM, AVI or MOV, and a CSV file.

    timestamp,x,y,z,qx,qy,qz,qw      6-DoF poses, or
    timestamp,x,y,heading            poses on the floor, as in layout csv

Times are seconds, ascending. Those of the frames are the exact ones of the video, which may have a
varying rate; option `start` puts the first frame on the clock of the poses. A pose is interpolated
between the two around a frame. The TOML or JSON file with the name of the video, or that of option
`camera`, describes the camera: see `camera_description`. Depth is a second video, of 16 bits.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.common.tables.csv_rows import parse_float
from s2rtools.common.video_files import Video
from s2rtools.datasets.recording import (
    Layout,
    ReadOptions,
    RecordedTrajectory,
    Recording,
    trajectory_name,
)
from s2rtools.datasets.recordings.camera_description import (
    describe_cameras,
    timed_poses,
)
from s2rtools.datasets.recordings.recorded_poses import mutual_nearest, poses_at
from s2rtools.datasets.recordings.stamped_lists import report_none_near
from s2rtools.datasets.recordings.video_images import ImageStream, VideoImages, frames_of

MAX_GAP = 0.5
"""Seconds between two poses that are interpolated."""
TOLERANCE = 0.02
"""Seconds between a frame and its depth image."""


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a video, its poses and the description of its camera; frames are not decoded.

    Raises RequestError if one of them is missing or malformed.
    """
    if not path.is_file():
        raise RequestError(f"{path}: {'no regular file' if path.exists() else 'no such file'}")
    name = trajectory_name(path.stem)
    recording = Recording("video", name, path.parent, allow_outside=options.allow_outside)
    description = describe_cameras(recording, options.values.get("camera"), path)
    csv = recording.resolve(options.values.get("poses", f"{path.stem}.csv"))
    known_times, known_poses = timed_poses(recording, csv, description)
    with Video(path) as video:
        times, size, codec = video.times, video.size, video.codec
    if not times.size:
        raise RequestError(f"{path}: no frames in it")
    start = options.values.get("start")
    shift = 0.0 if start is None else parse_float(start) - float(times[0])
    if not np.isfinite(shift):
        raise RequestError(f"option start={start}: must be a number of seconds")
    every = options.positive("every", 1.0)
    if every != int(every):
        raise RequestError(f"option every={options.values['every']}: must be a whole number")
    poses = poses_at(times + shift, known_times, known_poses, MAX_GAP, max_hold=0)
    posed = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    depth_rows = np.zeros(len(times), dtype=np.intp)
    depth_size, depth, depth_times = size, options.named_depth, times
    if depth is not None:
        with Video(recording.resolve(depth)) as video:
            video.require_depth()
            depth_rows, depth_size = mutual_nearest(times, video.times, TOLERANCE), video.size
            depth_times = video.times + shift
    rows = np.arange(0, len(times), int(every))
    for kind, is_lost, known, rule in (
        ("no pose", ~posed, known_times, f"not between two poses {MAX_GAP * 1000:g} ms apart"),
        ("no depth image", depth_rows < 0, depth_times, f"none within {TOLERANCE * 1000:g} ms"),
    ):
        lost = [(f"{path.name}:{row}", float(times[row] + shift)) for row in rows[is_lost[rows]]]
        report_none_near(recording, kind, lost, known, rule)
        rows = rows[~is_lost[rows]]
    streams = [ImageStream(VideoImages(recording.containment, codec), path.name, rows, size)]
    if depth is not None:
        images = VideoImages(recording.containment, "depth")
        streams.append(ImageStream(images, depth, depth_rows[rows], depth_size))
    recording.trajectories[recording.only_name] = RecordedTrajectory(
        frames_of(streams), poses[rows], times[rows] + shift
    )
    recording.provenance |= {"codec": codec, "poses": csv.name, "max_gap_s": MAX_GAP}
    return recording


LAYOUT = Layout(
    read,
    "video and a CSV file with the poses of its camera",
    {
        "poses": "CSV file beside the video (default: that with the name of the video)",
        "camera": "TOML or JSON file that describes the camera (default: that beside the video)",
        "depth": "video of depth beside it, of 16 bits, such as FFV1 in MKV, by default none",
        "start": "time of the first frame on the clock of the poses, s (default: the video's own)",
        "every": "read one of so many frames (default 1)",
    },
)
