"""Cameras of recordings that a publication, a file or the user states."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from s2rstore.errors import RequestError
from s2rtools.common.image_files import MAX_PIXELS
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.recording import PinholeCamera, ReadOptions

CAMERA_OPTION = (
    "intrinsics fx,fy,cx,cy[,width,height] in pixels, with the centre of the first pixel at 0 as "
    "OpenCV gives them; width and height are those of the images by default"
)
_MAX_FOCAL = 1e6
_DISTORTION_LENGTHS = (0, 4, 5, 8, 12, 14)


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


def checked(camera: PinholeCamera, where: str) -> PinholeCamera:
    """The camera. Raises RequestError, beginning with `where`, for values that none can have."""
    if camera.width < 1 or camera.height < 1 or camera.width * camera.height > MAX_PIXELS:
        size = f"{camera.width}x{camera.height}"
        raise RequestError(f"{where}: images of {size} pixels; at most {MAX_PIXELS:,} are read")
    for name in ("fx", "fy"):
        if not 0 < getattr(camera, name) <= _MAX_FOCAL:
            value = getattr(camera, name)
            raise RequestError(f"{where}: {name} is {value:g}; expected 0 < {name} <= 1,000,000")
    for name in ("cx", "cy"):
        if not abs(getattr(camera, name)) <= _MAX_FOCAL:
            raise RequestError(f"{where}: {name} is {getattr(camera, name):g}")
    if not all(math.isfinite(value) for value in camera.distortion):
        raise RequestError(f"{where}: the distortion is not finite")
    lengths = (4,) if camera.is_fisheye else _DISTORTION_LENGTHS
    if len(camera.distortion) not in lengths:
        count = f"{len(camera.distortion)} coefficients of distortion"
        raise RequestError(f"{where}: {count}; OpenCV has {', '.join(map(str, lengths))}")
    return camera


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
    return checked(opencv_camera(size, (values[0], values[1], values[2], values[3])), form)


def fit_to_images(
    camera: PinholeCamera,
    size: tuple[int, int],
    path: Path,
    issues: list[InputIssue],
    option: str = "camera",
) -> PinholeCamera:
    """The camera for images of (height, width) that were resized; reported if they were.

    `option` is the one that states the camera. Distortion does not depend on the size.
    """
    height, width = size
    if (camera.width, camera.height) == (width, height):
        return camera
    columns, rows = width / camera.width, height / camera.height
    detail = (
        f"{option}: for {camera.width}x{camera.height} pixels, images have {width}x{height}; "
        f"scaled, which is wrong for cropped images: state theirs by option {option}"
    )
    issues.append(InputIssue("intrinsics of another size", path.as_posix(), detail))
    return replace(
        camera,
        width=width,
        height=height,
        fx=camera.fx * columns,
        fy=camera.fy * rows,
        cx=camera.cx * columns,
        cy=camera.cy * rows,
    )
