"""Read `sensor.yaml` of the ASL layout: the mount of a sensor, and the calibration of a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rtools.common.typed_documents import convert
from s2rtools.common.yaml_files import read_yaml
from s2rtools.datasets.recording import PinholeCamera
from s2rtools.datasets.recordings.recorded_poses import orthonormal, usable_poses
from s2rtools.datasets.recordings.stated_cameras import opencv_camera

_MODELS = ("radial-tangential", "radtan", "plumb_bob", "equidistant", "none")


class _Matrix(Struct):
    data: Annotated[list[float], Meta(min_length=16, max_length=16)]


class Sensor(Struct):
    """The part of a `sensor.yaml` that places the sensor."""

    T_BS: _Matrix

    def mount(self, path: Path) -> NDArray[np.float64]:
        """The sensor's pose (4, 4) in the body's axes. Raises RequestError unless it is one."""
        pose = np.array(self.T_BS.data).reshape(1, 4, 4)
        if not usable_poses(pose)[0]:
            raise RequestError(f"{path}: T_BS: not a pose (rotation matrix and position in metres)")
        return orthonormal(pose)[0]


class CameraSensor(Sensor):
    """The `sensor.yaml` of a camera."""

    camera_model: str
    intrinsics: Annotated[list[float], Meta(min_length=4, max_length=4)]
    distortion_model: str = "none"
    distortion_coefficients: list[float] = []
    resolution: Annotated[list[int], Meta(min_length=2, max_length=2)] | None = None

    def pinhole(self, size: tuple[int, int], path: Path) -> PinholeCamera:
        """The camera for images of (height, width)."""
        if self.camera_model != "pinhole":
            raise RequestError(f"{path}: camera_model {self.camera_model!r}: expected pinhole")
        fx, fy, cx, cy = self.intrinsics
        model = self.distortion_model.lower()
        if model not in _MODELS:
            raise RequestError(
                f"{path}: distortion_model {self.distortion_model!r}: choose from "
                f"{', '.join(_MODELS)}"
            )
        distortion = () if model == "none" else tuple(self.distortion_coefficients)
        camera = opencv_camera(size, (fx, fy, cx, cy), distortion, model == "equidistant")
        return camera.checked(str(path))


Kind = TypeVar("Kind", bound=Sensor)


def read_sensor(path: Path, kind: type[Kind]) -> Kind:
    """Read a file. Raises RequestError if it is missing or has not the keys of `kind`."""
    return convert(read_yaml(path), kind, str(path), check=False)
