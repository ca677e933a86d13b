"""Read and check the files of a frame that a renderer program has written."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.files import safe_files
from s2rstore.files.image_header import PNG_MAGIC, check_integrity, read_header
from s2rtools.renderer.protocol import Hello

_NPY_MAGIC = b"\x93NUMPY"
_HEADER_BYTES = 1 << 16
MILLIMETRES = 0.001


@dataclass(frozen=True, slots=True, eq=False)
class RenderedFrame:
    """A frame that is checked: the bytes of its PNG, and depth (height, width) float32 metres.

    Depth is 0 where there is none, and None of a renderer without depth.
    """

    png: bytes
    depth: NDArray[np.float32] | None


def read_frame(camera: Hello, rgb: str, depth: str | None) -> RenderedFrame:
    """Read the named files in the camera's folder; without `depth`, RGB alone.

    Raises ValueError, which names the file, where one is missing, is a link, or is not an image of
    the type and size of the protocol.
    """
    png = _read(camera, rgb, 4)
    with _named(rgb):
        _check_rgb(png, camera)
    if depth is None:
        return RenderedFrame(png, None)
    content = _read(camera, depth, 8)
    with _named(depth):
        return RenderedFrame(png, _depth(content, camera))


@contextmanager
def _named(name: str) -> Iterator[None]:
    """Errors name the file."""
    try:
        yield
    except (ValueError, cv2.error) as error:
        raise ValueError(f"{name}: {error}") from error


def _read(camera: Hello, name: str, bytes_per_pixel: int) -> bytes:
    limit = bytes_per_pixel * camera.width * camera.height + _HEADER_BYTES
    try:
        return safe_files.read(Path(camera.folder), name, limit)
    except FileNotFoundError as error:
        raise ValueError(f"{name}: was not written") from error
    except safe_files.LinkError as error:
        raise ValueError(f"{name}: is a symbolic link") from error
    except (OSError, RequestError) as error:
        text = str(error).removeprefix(f"{Path(camera.folder) / name}: ")
        raise ValueError(f"{name}: {text}") from error


def _check_rgb(content: bytes, camera: Hello) -> None:
    bits = _check_png(content, camera)
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if bits != 8 or image is None or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError("is not an 8-bit RGB PNG")


def _depth(content: bytes, camera: Hello) -> NDArray[np.float32]:
    metres = (
        _npy(content, camera) if content.startswith(_NPY_MAGIC) else _depth_png(content, camera)
    )
    if not np.isfinite(metres).all():
        raise ValueError("holds depth that is not finite; 0 means none")
    if metres.min(initial=0) < 0:
        raise ValueError("holds negative depth; 0 means none")
    return metres


def _depth_png(content: bytes, camera: Hello) -> NDArray[np.float32]:
    if not content.startswith(PNG_MAGIC):
        raise ValueError("is neither .npy nor PNG")
    bits = _check_png(content, camera)
    image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if bits != 16 or image is None or image.ndim != 2:
        raise ValueError("is not a 16-bit grey PNG")
    return np.asarray(image * np.float32(MILLIMETRES), dtype=np.float32)


def _check_png(content: bytes, camera: Hello) -> int:
    """The bits per sample of a whole PNG of the camera's size."""
    header = read_header(content)
    if header.format != "PNG":
        raise ValueError(f"is {header.format}, not PNG")
    _check_size(header.size, camera)
    check_integrity(content, header)
    return header.bits


def _npy(content: bytes, camera: Hello) -> NDArray[np.float32]:
    file = io.BytesIO(content)
    version = np.lib.format.read_magic(file)
    read = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in read:
        raise ValueError(f"is .npy of version {version}")
    shape, by_columns, dtype = read[version](file)
    if dtype != np.dtype("<f4"):
        raise ValueError(f"is {dtype}, not float32")
    _check_size(shape, camera)
    values = np.frombuffer(content, dtype, offset=file.tell())
    if values.size != camera.width * camera.height:
        raise ValueError("is cut or too long")
    return values.reshape(shape, order="F" if by_columns else "C")


def _check_size(size: tuple[int, ...], camera: Hello) -> None:
    if size != (camera.height, camera.width):
        text = " x ".join(map(str, reversed(size))) or "a single value"
        raise ValueError(f"is {text} pixels, not {camera.width} x {camera.height}")
