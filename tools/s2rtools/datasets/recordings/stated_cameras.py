"""Cameras of recordings: stated by a publication, a file or the user; one chosen of several."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from pathlib import Path

import numpy as np

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import PinholeCamera, ReadOptions, Recording
from s2rtools.datasets.recordings.recorded_files import commonest_size

CAMERA_OPTION = (
    "intrinsics fx,fy,cx,cy[,width,height] in pixels, with the centre of the first pixel at 0 as "
    "OpenCV gives them; width and height are those of the images by default"
)
CAMERA_ID = "camera_id"
"""Name of the option."""
MEDIAN = "median"
"""Value of the option `camera_id` for the median of all cameras, which must have one image size."""
_MOST_NAMED = 8
"""Cameras that a message lists."""


def opencv_camera(
    size: tuple[int, int],
    intrinsics: tuple[float, float, float, float],
    distortion: tuple[float, ...] = (),
    is_fisheye: bool = False,
) -> PinholeCamera:
    """A camera of (height, width) from fx, fy, cx, cy with the centre of the first pixel at 0."""
    fx, fy, cx, cy = intrinsics
    return PinholeCamera(
        size[1], size[0], fx, fy, cx + 0.5, cy + 0.5, tuple(distortion), is_fisheye
    )


def camera_option(options: ReadOptions, name: str, size: tuple[int, int]) -> PinholeCamera | None:
    """The camera that the option `name` states, for images of (height, width) by default.

    None without the option. Raises RequestError if it is not of the form in `CAMERA_OPTION`.
    """
    text = options.values.get(name)
    if text is None:
        return None
    form = f"option {name}={text}: expected fx,fy,cx,cy or fx,fy,cx,cy,width,height"
    try:
        values = [float(field) for field in text.split(",")]
    except ValueError:
        raise RequestError(form) from None
    if len(values) not in (4, 6) or not all(math.isfinite(value) for value in values):
        raise RequestError(form)
    if len(values) == 6:
        if not (values[4].is_integer() and values[5].is_integer()):
            raise RequestError(form)
        size = int(values[5]), int(values[4])
    return opencv_camera(size, (values[0], values[1], values[2], values[3])).checked(form)


def fitted_camera(
    recording: Recording,
    options: ReadOptions,
    option: str,
    default: PinholeCamera,
    depth: bool = False,
) -> PinholeCamera:
    """The camera that an option states, or else the default, for the size of the images.

    That is the commonest one of the RGB or the `depth` images. Intrinsics for another size are
    scaled and reported.
    """
    height, width = image_size(recording, depth)
    camera = camera_option(options, option, (height, width)) or default
    if (camera.width, camera.height) == (width, height):
        return camera
    detail = (
        f"{option}: for {camera.width}x{camera.height} pixels, images have {width}x{height}; "
        f"scaled, which is wrong for cropped images: state theirs by option {option}"
    )
    recording.report("intrinsics of another size", recording.root.as_posix(), detail)
    return camera.resized((height, width))


def image_size(recording: Recording, depth: bool = False) -> tuple[int, int]:
    """The commonest (height, width) of the RGB or `depth` images of the longest trajectory.

    Raises RequestError if there is no image, or none that can be read.
    """
    recording.require_frames()
    frames = max((each.frames for each in recording.trajectories.values()), key=len)
    return commonest_size(frames, recording.root, depth)


def choose_camera(
    cameras: Mapping[str, PinholeCamera], images: Sequence[str], option: str | None, where: Path
) -> tuple[PinholeCamera, frozenset[str], str]:
    """The camera of a recording, the names of those whose images it stands for, and a remark.

    `images` names the camera of each image. The option names one camera, or is `MEDIAN`: then the
    remark states how far a camera is from the median. By default all cameras must be equal. Raises
    RequestError, which lists the cameras, if there are several or the option names none.
    """
    present = frozenset(images)
    used = {name: camera for name, camera in cameras.items() if name in present}
    if option is not None and option != MEDIAN:
        if option not in used:
            raise RequestError(f"{where}: no images of camera {option!r} ({_listed(used, images)})")
        return used[option], frozenset((option,)), ""
    first = next(iter(used.values()))
    if all(camera == first for camera in used.values()):
        return first, frozenset(used), ""
    kinds = {
        (each.width, each.height, each.is_fisheye, len(each.distortion)) for each in used.values()
    }
    if option is None or len(kinds) > 1:
        advice = "choose one with option camera_id=NAME"
        if len(kinds) == 1:
            advice += f", or their median with camera_id={MEDIAN}"
        raise RequestError(f"{where}: {len(used)} cameras ({_listed(used, images)}); {advice}")
    values = np.array([(*astuple(each)[2:6], *each.distortion) for each in used.values()])
    fx, fy, cx, cy, *distortion = np.median(values, axis=0).tolist()
    camera = PinholeCamera(
        first.width, first.height, fx, fy, cx, cy, tuple(distortion), first.is_fisheye
    )
    spread = np.abs(values - np.median(values, axis=0)).max(axis=0)
    focal, centre = spread[:2].max(), spread[2:4].max()
    remark = f"median of {len(used)} cameras; focal lengths differ by at most {focal:.2f} pixels, "
    return camera, frozenset(used), remark + f"centres by {centre:.2f}"


def _listed(cameras: Mapping[str, PinholeCamera], images: Sequence[str]) -> str:
    texts = [
        f"{name}: {camera.width}x{camera.height}, fx {camera.fx:.1f}, {images.count(name)} images"
        for name, camera in list(cameras.items())[:_MOST_NAMED]
    ]
    more = len(cameras) - len(texts)
    return "; ".join(texts) + (f"; and {more} more" if more else "")
