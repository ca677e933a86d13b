"""Read the cameras and images of a COLMAP model, as text or binary.

COLMAP places the centre of pixel i at i + 0.5, so that its intrinsics need no conversion. Source:
"Output Format" and "Camera Models" of COLMAP's documentation. Binary files are little-endian:
`cameras.bin` has a count (uint64), then for each camera id (int32), model (int32), width and height
(uint64) and its parameters (float64); `images.bin` has a count, then for each image id (int32),
quaternion w, x, y, z and translation (7 float64), camera id (int32), its name ended by a zero byte,
and the number of its points (uint64) with 24 bytes each.
"""

from __future__ import annotations

import io
import math
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files.input_files import open_regular, read_bytes, read_text
from s2rtools.datasets.recording import PinholeCamera, existing_folder
from s2rtools.datasets.recordings.recorded_poses import poses_from_quaternions

_MODELS = (
    ("SIMPLE_PINHOLE", "f cx cy"),
    ("PINHOLE", "fx fy cx cy"),
    ("SIMPLE_RADIAL", "f cx cy k1"),
    ("RADIAL", "f cx cy k1 k2"),
    ("OPENCV", "fx fy cx cy k1 k2 p1 p2"),
    ("OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4"),
    ("FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    ("FOV", ""),
    ("SIMPLE_RADIAL_FISHEYE", "f cx cy k1"),
    ("RADIAL_FISHEYE", "f cx cy k1 k2"),
)
"""Names and parameters by model number; without parameters, a model is not read."""
_MODEL_FOLDERS = (".", "sparse", "colmap/sparse")
_LEVELS = 4
"""Folders above a model, with itself, in which `images` is looked for."""
_MAX_CAMERA_BYTES = 256 << 20
_MAX_LINE_BYTES = 64 << 20
"""Bytes of a line of 2D points."""
_MAX_NAME_BYTES = 4096
_MAX_IMAGES = 2_000_000
_POINT_BYTES = 24
_IMAGE = struct.Struct("<i7di")
_CAMERA = struct.Struct("<iiQQ")


@dataclass(frozen=True, slots=True)
class ModelImage:
    """An image: camera, quaternion w, x, y, z and translation from the world to the camera."""

    name: str
    camera: int
    quaternion: tuple[float, float, float, float]
    translation: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Model:
    cameras: dict[int, PinholeCamera]
    images: list[ModelImage]


def find_model(path: Path) -> Path:
    """The folder of the only model in a folder, its `sparse` or `sparse/N`.

    Raises RequestError if there is none, or several.
    """
    found = list(_models(existing_folder(path)))
    if not found:
        raise RequestError(f"{path}: no cameras.txt with images.txt (or .bin) in it or in sparse/0")
    if len(found) > 1:
        names = ", ".join(str(each) for each in found[:8])
        raise RequestError(f"{path}: several models; give the path of one of {names}")
    return found[0]


def _models(path: Path) -> Iterator[Path]:
    for name in _MODEL_FOLDERS:
        folder = path / name
        if _holds_model(folder):
            yield folder
            return
        if name != "." and folder.is_dir():
            found = [each for each in sorted(folder.iterdir()) if _holds_model(each)]
            if found:
                yield from found
                return


def find_images(model: Path, option: str | None) -> Path:
    """The folder of a model's images: the `option`, or the folder `images` beside the model.

    Raises RequestError if there is none.
    """
    if option is not None:
        if not Path(option).is_dir():
            raise RequestError(f"option images={option}: no such folder")
        return Path(option)
    folders = [model.resolve(), *model.resolve().parents][:_LEVELS]
    for folder in folders:
        if (folder / "images").is_dir():
            return folder / "images"
    raise RequestError(f"{model}: no folder `images` beside the model; name it, images=FOLDER")


def read_model(folder: Path) -> Model:
    """Read the binary model of a folder, or its text model if there is no binary one.

    Raises RequestError, naming file and line or camera, if it is damaged, or has images of a camera
    whose model is not read.
    """
    suffix = "bin" if _has(folder, "bin") else "txt"
    read_cameras, read_images = (
        (_binary_cameras, _binary_images) if suffix == "bin" else (_text_cameras, _text_images)
    )
    described = dict(read_cameras(folder / f"cameras.{suffix}"))
    path = folder / f"images.{suffix}"
    images = []
    for image in read_images(path):
        if image.camera not in described:
            raise RequestError(f"{path}: image {image.name!r} is of camera {image.camera}, unknown")
        images.append(image)
        if len(images) > _MAX_IMAGES:
            raise RequestError(f"{path}: more than {_MAX_IMAGES:,} images; split the model")
    if not images:
        raise RequestError(f"{path}: no images in it")
    used = {image.camera for image in images}
    return Model({number: described[number].pinhole() for number in sorted(used)}, images)


@dataclass(frozen=True, slots=True)
class _Camera:
    """A camera as it stands in the file; `where` names its place."""

    model: str
    width: int
    height: int
    parameters: tuple[float, ...]
    where: str

    def pinhole(self) -> PinholeCamera:
        names = dict(_MODELS).get(self.model, "").split()
        if not names:
            known = ", ".join(name for name, parameters in _MODELS if parameters)
            raise RequestError(f"{self.where}: model {self.model} is not read (reads {known})")
        if len(names) != len(self.parameters):
            count = len(self.parameters)
            raise RequestError(f"{self.where}: {count} parameters; {self.model} has {len(names)}")
        values = dict(zip(names, self.parameters, strict=True))
        is_fisheye = self.model.endswith("_FISHEYE")
        order = "k1 k2 k3 k4" if is_fisheye else "k1 k2 p1 p2 k3 k4 k5 k6"
        used = order.split()[: 8 if "k6" in names else 4]
        distortion = tuple(values.get(name, 0.0) for name in used)
        camera = PinholeCamera(
            self.width,
            self.height,
            values.get("fx", values.get("f", math.nan)),
            values.get("fy", values.get("f", math.nan)),
            values["cx"],
            values["cy"],
            distortion if any(distortion) or is_fisheye else (),
            is_fisheye,
        )
        return camera.checked(self.where)


def camera_poses(values: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
    """Poses (N, 4, 4) of the camera in the world, positions times `scale`.

    `values` (N, 7) are quaternions w, x, y, z and translations from the world to the camera.
    """
    translations = values[:, 4:]
    poses = poses_from_quaternions(translations, values[:, [1, 2, 3, 0]])
    inverse = np.swapaxes(poses[:, :3, :3], 1, 2).copy()
    with np.errstate(over="ignore", invalid="ignore"):
        poses[:, :3, 3] = -scale * np.einsum("nij,nj->ni", inverse, translations)
    poses[:, :3, :3] = inverse
    return poses


def _text_cameras(path: Path) -> Iterator[tuple[int, _Camera]]:
    lines = read_text(path, _MAX_CAMERA_BYTES).splitlines()
    for number, line in enumerate(lines, start=1):
        values = line.split()
        if not values or values[0].startswith("#"):
            continue
        where = f"{path}:{number}"
        try:
            identity, width, height = (int(values[field]) for field in (0, 2, 3))
            parameters = tuple(float(value) for value in values[4:])
        except (ValueError, IndexError):
            raise RequestError(f"{where}: not `id model width height parameters`") from None
        yield identity, _Camera(values[1], width, height, parameters, where)


def _binary_cameras(path: Path) -> Iterator[tuple[int, _Camera]]:
    file = io.BytesIO(read_bytes(path, _MAX_CAMERA_BYTES))
    counts = {number: len(names.split()) for number, (_, names) in enumerate(_MODELS)}
    for _ in range(struct.unpack("<Q", _exactly(file, 8, path))[0]):
        identity, model, width, height = _CAMERA.unpack(_exactly(file, _CAMERA.size, path))
        where = f"{path}: camera {identity}"
        if not counts.get(model):
            name = _MODELS[model][0] if model in counts else f"number {model}"
            raise RequestError(f"{where}: model {name} is not read")
        content = _exactly(file, 8 * counts[model], path)
        parameters = struct.unpack(f"<{counts[model]}d", content)
        yield identity, _Camera(_MODELS[model][0], width, height, parameters, where)


def _text_images(path: Path) -> Iterator[ModelImage]:
    with open_regular(path) as file:
        number = 0
        while line := file.readline(_MAX_LINE_BYTES):
            number += 1
            values = line.split(maxsplit=9)
            if not values or values[0].startswith(b"#"):
                continue
            where = f"{path}:{number}"
            try:
                int(values[0])
                w, x, y, z, *translation = (float(value) for value in values[1:8])
                camera, name = int(values[8]), values[9].strip().decode()
                u, v, t = translation
            except (ValueError, IndexError):
                raise RequestError(f"{where}: not `id qw qx qy qz tx ty tz camera name`") from None
            yield ModelImage(name, camera, (w, x, y, z), (u, v, t))
            number += 1
            _skip_points(file, f"{path}:{number}")


def _skip_points(file: io.BufferedReader, where: str) -> None:
    """Skip the line of an image's 2D points: x, y and the point's number for each, or nothing."""
    line = file.readline(_MAX_LINE_BYTES)
    if len(line) == _MAX_LINE_BYTES:
        raise RequestError(f"{where}: longer than {_MAX_LINE_BYTES:,} bytes")
    words = line.split()
    try:
        is_points = len(words) % 3 == 0 and all(math.isfinite(float(word)) for word in words[-3:])
    except ValueError:
        is_points = False
    if not is_points:
        raise RequestError(
            f"{where}: no line of 2D points; every image has two lines, the second may be empty"
        )


def _binary_images(path: Path) -> Iterator[ModelImage]:
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        for _ in range(struct.unpack("<Q", _exactly(file, 8, path))[0]):
            _, w, x, y, z, u, v, t, camera = _IMAGE.unpack(_exactly(file, _IMAGE.size, path))
            name = _name(file, path)
            (points,) = struct.unpack("<Q", _exactly(file, 8, path))
            if points * _POINT_BYTES > size - file.tell():
                raise _cut(path)
            file.seek(points * _POINT_BYTES, os.SEEK_CUR)
            yield ModelImage(name, camera, (w, x, y, z), (u, v, t))


def _name(file: io.BufferedReader, path: Path) -> str:
    start = file.tell()
    content = b""
    while b"\0" not in content and len(content) <= _MAX_NAME_BYTES:
        block = file.read(256)
        if not block:
            raise _cut(path)
        content += block
    name, end, _ = content.partition(b"\0")
    file.seek(start + len(name) + 1)
    try:
        if not end:
            raise ValueError
        return name.decode()
    except ValueError:
        raise RequestError(
            f"{path}: damaged at byte {start}: no file name; copy it again"
        ) from None


def _exactly(file: io.BytesIO | io.BufferedReader, count: int, path: Path) -> bytes:
    content = file.read(count)
    if len(content) != count:
        raise _cut(path)
    return content


def _cut(path: Path) -> RequestError:
    return RequestError(f"{path}: it ends before its last entry; copy it again")


def _holds_model(folder: Path) -> bool:
    return any(_has(folder, suffix) for suffix in ("bin", "txt"))


def _has(folder: Path, suffix: str) -> bool:
    return (folder / f"cameras.{suffix}").is_file() and (folder / f"images.{suffix}").is_file()
