"""KITTI odometry: `sequences/NN/{calib.txt,times.txt,image_0..image_3}` and `poses/NN.txt`.

A line of `poses/NN.txt` is the 3x4 matrix from the axes of camera 0 (x right, y down, z forward) at
that image to those at the first image, metres. `P0` to `P3` in `calib.txt` are the projections of
the rectified cameras 0 to 3 from the axes of camera 0: camera i lies at -K^-1 p in them, K the left
3x3 part and p the last column. Images are rectified; 0 and 1 are grey, 2 and 3 are in colour. There
is no depth. The world's up is -y of the first image, whose camera is mounted level: a slope of the
road there tilts it.

The calibration was published with OpenCV's rectification, so the centre of the first pixel is taken
as 0; the data set does not state it.
"""

from __future__ import annotations

import re
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import Layout, PinholeCamera, ReadOptions, Recording
from s2rtools.datasets.recordings.kitti_files import add_frames, read_projection
from s2rtools.datasets.recordings.recorded_files import commonest_size
from s2rtools.datasets.recordings.stated_cameras import opencv_camera
from s2rtools.datasets.scan import choose_trajectories

_SEQUENCE = re.compile(r"[0-9]{2,4}")
_CAMERAS = ("2", "0", "1", "3")
"""In order of preference: colour before grey, left before right."""


def read(path: Path, options: ReadOptions) -> Recording:
    """Read the data set's folder, or one folder `sequences/NN`.

    Raises RequestError if files are missing or unusable, and if sequences have several cameras.
    """
    recording = Recording.of_folder("kitti", path, options)
    names = _sequences(path)
    if not names:
        whole = path.resolve()
        if whole.parent.name != "sequences" or not (whole / "calib.txt").is_file():
            raise RequestError(f"{path}: neither sequences/NN nor calib.txt in it")
        names = [whole.name]
        recording = Recording.of_folder("kitti", whole.parent.parent, options)
        recording.name = whole.name
    root = recording.root
    posed = [name for name in names if (root / "poses" / f"{name}.txt").is_file()]
    if not posed:
        raise RequestError(f"{root / 'poses' / f'{names[0]}.txt'}: missing; no poses to read")
    chosen = choose_trajectories(options.trajectories, posed, path)
    for name in sorted(set(names) - set(posed)):
        recording.report("no poses", f"sequences/{name}", f"no poses/{name}.txt")
    camera = options.values.get("camera") or _first_camera(root / "sequences" / chosen[0])
    if camera not in _CAMERAS:
        raise RequestError(f"option camera={camera}: choose from {', '.join(sorted(_CAMERAS))}")
    cameras: dict[PinholeCamera, str] = {}
    for name in chosen:
        matrix, place = read_projection(recording, f"sequences/{name}/calib.txt", f"P{camera}")
        add_frames(recording, name, camera, matrix)
        if len(frames := recording.trajectories[name].frames):
            size = commonest_size(frames, root)
            fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
            cameras.setdefault(opencv_camera(size, (fx, fy, cx, cy)).checked(place), name)
    recording.require_frames()
    recording.camera, *others = cameras
    if others:
        raise RequestError(
            f"{root}: the cameras of sequences {' and '.join(list(cameras.values())[:2])} differ; "
            f"read one, such as {root / 'sequences' / cameras[recording.camera]}"
        )
    recording.up, recording.has_own_worlds = (0.0, -1.0, 0.0), True
    recording.provenance = {"camera": f"image_{camera}"}
    return recording


def _sequences(folder: Path) -> list[str]:
    if not (folder / "sequences").is_dir():
        return []
    found = (each for each in (folder / "sequences").iterdir() if each.is_dir())
    return sorted(each.name for each in found if _SEQUENCE.fullmatch(each.name))


def _first_camera(folder: Path) -> str:
    for camera in _CAMERAS:
        if (folder / f"image_{camera}").is_dir():
            return camera
    raise RequestError(f"{folder}: no folder image_0, image_1, image_2 or image_3")


LAYOUT = Layout(
    read,
    "KITTI odometry: sequences/NN and poses/NN.txt",
    {"camera": "0 to 3: the images in image_N (default: 2, else 0)"},
)
