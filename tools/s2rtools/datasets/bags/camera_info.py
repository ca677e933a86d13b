"""The intrinsics of a camera from a message CameraInfo of ROS 1 or 2."""

from __future__ import annotations

from typing import Any

from s2rstore.errors import RequestError
from s2rtools.datasets.recording import PinholeCamera

INFO = "sensor_msgs/msg/CameraInfo"
_FISHEYES = ("equidistant", "fisheye")
_PINHOLES = ("", "plumb_bob", "rational_polynomial", "none")


def camera_of(message: Any, where: str, is_rectified: bool) -> PinholeCamera:
    """The camera that a CameraInfo states, for images as they are recorded.

    ROS places the centre of pixel i at i; it is moved to i + 0.5. Binning and the region of
    interest are applied. Rectified images have the projection P and no distortion, others K and D.
    Raises RequestError, beginning with `where`, for an uncalibrated camera or an unknown model.
    """
    k, p, d = (_field(message, name) for name in "kpd")
    fx, fy, cx, cy = (p[0], p[5], p[2], p[6]) if is_rectified else (k[0], k[4], k[2], k[5])
    if not fx > 0:
        raise RequestError(f"{where}: the camera is not calibrated; set camera=fx,fy,cx,cy")
    model = message.distortion_model
    distortion = () if is_rectified or not any(d) else tuple(d)
    if distortion and model not in _PINHOLES + _FISHEYES:
        raise RequestError(f"{where}: distortion model {model[:40]!r} is not read; rectify images")
    is_fisheye = model in _FISHEYES and not is_rectified
    if is_fisheye and not distortion:
        distortion = (0.0, 0.0, 0.0, 0.0)
    roi = message.roi
    columns, rows = max(1, int(message.binning_x)), max(1, int(message.binning_y))
    camera = PinholeCamera(
        int(roi.width or message.width) // columns,
        int(roi.height or message.height) // rows,
        fx / columns,
        fy / rows,
        (cx + 0.5 - roi.x_offset) / columns,
        (cy + 0.5 - roi.y_offset) / rows,
        distortion,
        is_fisheye,
    )
    return camera.checked(where)


def _field(message: Any, name: str) -> list[float]:
    """A field that ROS 1 names in capitals and ROS 2 in small letters."""
    values = getattr(message, name, None)
    return [float(v) for v in (getattr(message, name.upper()) if values is None else values)]
