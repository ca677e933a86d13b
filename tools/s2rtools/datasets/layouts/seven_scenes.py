"""7-Scenes: folders `seq-XX` of `frame-NNNNNN.{color.png,depth.png,pose.txt}`.

Poses are matrices from the axes of the camera (x right, y down, z forward) to the world, metres;
the direction of gravity is not known. Depth is in millimetres, 65535 and 0 for none.
`TrainSplit.txt` and `TestSplit.txt` list the sequences of the published splits, as lines
`sequence1`.

The page of the data set gives one calibration: principal point (320, 240) and focal length 585 of
the depth camera, the default of the tracking that made the poses. It states that the colour camera
is not calibrated and that both images are raw, not registered; the poses are those of the depth
camera, and the colour camera lies about 25 mm beside it. For the colour camera the reader takes a
focal length of 525, the default of the OpenNI driver, which DSAC++ and its successors use for this
data set; option `camera` states another. The page does not tell where the pixels' centres are: both
principal points are taken as the middle of the image.
"""

from __future__ import annotations

import re
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.common.tables.text_lines import read_lines
from s2rtools.datasets.recording import (
    DEPTH_OPTION,
    Layout,
    PinholeCamera,
    ReadOptions,
    Recording,
)
from s2rtools.datasets.recordings.frame_table import read_frames
from s2rtools.datasets.recordings.stated_cameras import CAMERA_OPTION, fitted_camera
from s2rtools.datasets.scan import choose_trajectories

RAW_MAX = 65534
_COLOUR = PinholeCamera(640, 480, 525.0, 525.0, 320.0, 240.0)
_DEPTH = PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0)
_SEQUENCE = re.compile(r"seq-[0-9]{1,6}")
_FILES = {
    "rgb": re.compile(r"frame-([0-9]+)\.color\.(?:png|jpg)"),
    "depth": re.compile(r"frame-([0-9]+)\.depth\.png"),
    "pose": re.compile(r"frame-([0-9]+)\.pose\.txt"),
}
_SPLITS = {"train": "TrainSplit.txt", "test": "TestSplit.txt"}
_SPLIT_LINE = re.compile(r"(?:sequence|seq-?)\s*([0-9]{1,6})", re.IGNORECASE)


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a scene, or one of its sequences. Raises RequestError if `path` is none."""
    recording = Recording.of_folder("7scenes", path, options)
    names = (p.name for p in sorted(path.iterdir()) if _SEQUENCE.fullmatch(p.name) and p.is_dir())
    folders = {name: f"{name}/" for name in names} or {recording.only_name: ""}
    if split := options.values.get("split"):
        listed = _listed(recording, split)
        for missing in sorted(listed - folders.keys()):
            recording.report("missing sequence", missing, f"listed in {_SPLITS[split]}")
        folders = {name: folder for name, folder in folders.items() if name in listed}
    for name in choose_trajectories(options.trajectories, folders, path):
        patterns = {
            kind: (folders[name], pattern)
            for kind, pattern in _FILES.items()
            if kind != "depth" or options.reads_depth
        }
        read_frames(recording, patterns, name)
    recording.camera = fitted_camera(recording, options, "camera", _COLOUR)
    if options.reads_depth:
        recording.depth_camera = fitted_camera(recording, options, "depth_camera", _DEPTH, True)
    recording.depth_raw_max = RAW_MAX
    recording.provenance = {
        "split": split or "all",
        "camera": "option" if "camera" in options.values else "default of OpenNI",
        "depth_camera": "option" if "depth_camera" in options.values else "published",
    }
    return recording


def _listed(recording: Recording, split: str) -> set[str]:
    """The names of the sequences of a split."""
    if split not in _SPLITS:
        raise RequestError(f"option split={split}: choose from {', '.join(_SPLITS)}")
    path = recording.resolve(_SPLITS[split])
    names = set()
    for number, line in read_lines(path):
        if text := line.strip():
            match = _SPLIT_LINE.fullmatch(text)
            if match is None:
                raise RequestError(f"{path}:{number}: {text[:40]!r}: expected `sequence1`")
            names.add(f"seq-{int(match[1]):02d}")
    if not names:
        raise RequestError(f"{path}: no sequence")
    return names


LAYOUT = Layout(
    read,
    "7-Scenes scene: seq-XX/frame-NNNNNN.{color.png,depth.png,pose.txt}",
    {
        "split": "train or test: only the sequences of TrainSplit.txt or TestSplit.txt",
        "camera": CAMERA_OPTION,
        "depth_camera": f"of the depth images: {CAMERA_OPTION}",
        "depth": DEPTH_OPTION,
    },
)
