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
from s2rtools.common.input_issue import InputIssue
from s2rtools.common.tables.text_lines import read_lines
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import (
    Layout,
    PinholeCamera,
    ReadOptions,
    RecordedTrajectory,
    Recording,
)
from s2rtools.datasets.recordings.pose_files import NumberedFrames, read_frames
from s2rtools.datasets.recordings.recorded_files import NumberedFiles, commonest_size
from s2rtools.datasets.recordings.recorded_folders import (
    existing_folder,
    folder_name,
    require_frames,
    trajectory_name,
)
from s2rtools.datasets.recordings.stated_cameras import CAMERA_OPTION, camera_option, fit_to_images
from s2rtools.datasets.scan import choose_trajectories

RAW_MAX = 65534
_COLOUR = PinholeCamera(640, 480, 525.0, 525.0, 320.0, 240.0)
_DEPTH = PinholeCamera(640, 480, 585.0, 585.0, 320.0, 240.0)
_SEQUENCE = re.compile(r"seq-[0-9]{1,6}")
_FILES = {
    kind: re.compile(rf"frame-([0-9]+)\.{kind}\.{suffix}")
    for kind, suffix in (("color", "(?:png|jpg)"), ("depth", "png"), ("pose", "txt"))
}
_SPLITS = {"train": "TrainSplit.txt", "test": "TestSplit.txt"}
_SPLIT_LINE = re.compile(r"(?:sequence|seq-?)\s*([0-9]{1,6})", re.IGNORECASE)


def read(path: Path, options: ReadOptions) -> Recording:
    """Read a scene, or one of its sequences. Raises RequestError if `path` is none."""
    folder = existing_folder(path)
    containment = PathContainment(folder, options.allow_outside)
    issues: list[InputIssue] = []
    sequences = {p.name: f"{p.name}/" for p in sorted(folder.iterdir()) if _is_sequence(p)}
    if not sequences:
        sequences = {trajectory_name(folder_name(folder)): ""}
    if split := options.values.get("split"):
        names = _listed(folder, split, containment)
        issues += [
            InputIssue("missing sequence", missing, f"listed in {_SPLITS[split]}")
            for missing in sorted(names - sequences.keys())
        ]
        sequences = {name: each for name, each in sequences.items() if name in names}
    trajectories: dict[str, RecordedTrajectory] = {}
    for name in choose_trajectories(options.trajectories, sequences, path):
        sub = sequences[name]
        rgb, depths, poses = (NumberedFiles(folder / sub, pattern) for pattern in _FILES.values())
        files = NumberedFrames(rgb, depths, poses, sub, sub, sub)
        trajectory = read_frames(folder, files, containment, issues)
        if len(trajectory.frames):
            trajectories[name] = trajectory
        else:
            issues.append(InputIssue("empty trajectory", name, "no usable frame"))
    require_frames("7scenes", folder, trajectories, issues)
    frames = max((each.frames for each in trajectories.values()), key=len)
    size = commonest_size(frames, folder)
    depth_size = commonest_size(frames, folder, depth=True)
    colour = camera_option(options, "camera", size) or _COLOUR
    depth = camera_option(options, "depth_camera", depth_size) or _DEPTH
    return Recording(
        layout="7scenes",
        name=folder_name(folder),
        root=folder,
        camera=fit_to_images(colour, size, folder, issues),
        depth_camera=fit_to_images(depth, depth_size, folder, issues, "depth_camera"),
        depth_raw_max=RAW_MAX,
        trajectories=trajectories,
        issues=issues,
        provenance={
            "split": split or "all",
            "camera": "option" if "camera" in options.values else "default of OpenNI",
            "depth_camera": "option" if "depth_camera" in options.values else "published",
        },
        outside_folders=containment.outside_folders,
    )


def _is_sequence(path: Path) -> bool:
    return _SEQUENCE.fullmatch(path.name) is not None and path.is_dir()


def _listed(folder: Path, split: str, containment: PathContainment) -> set[str]:
    """The names of the sequences of a split."""
    if split not in _SPLITS:
        raise RequestError(f"option split={split}: choose from {', '.join(_SPLITS)}")
    path = containment.resolve(_SPLITS[split], str(folder))
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
    },
)
