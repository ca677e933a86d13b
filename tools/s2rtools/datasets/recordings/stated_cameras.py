"""Cameras of recordings that a publication, a file or the user states."""

from __future__ import annotations

import math

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import PinholeCamera, ReadOptions, Recording
from s2rtools.datasets.recordings.recorded_files import commonest_size

CAMERA_OPTION = (
    "intrinsics fx,fy,cx,cy[,width,height] in pixels, with the centre of the first pixel at 0 as "
    "OpenCV gives them; width and height are those of the images by default"
)


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
