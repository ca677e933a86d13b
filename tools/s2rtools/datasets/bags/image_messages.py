"""Images of a topic of a bag by their stamps: `sensor_msgs/Image` and `CompressedImage`.

Depth becomes uint16. 16-bit depth keeps its units (millimetres by REP 118); metres in 32-bit floats
are rounded to millimetres, and 0 where they are not finite, not positive or above 65.534 m. Images
of `compressedDepth` begin with 12 bytes: a format and two parameters a, b (float32) by which the
PNG image of inverse depth v that follows stands for a / (v - b) metres, if its format is 32FC1.
Sources: REP 118, `sensor_msgs/image_encodings.hpp`, `compressed_depth_image_transport`.
"""

from __future__ import annotations

import hashlib
import struct
from array import array
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError, counted
from s2rstore.files.image_header import read_header
from s2rtools.common.bag_files import refusing_damage
from s2rtools.common.bag_messages import BagMessages, frame_name, stamp_of
from s2rtools.common.image_files import MAX_PIXELS
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.image_decoding import (
    decode_image,
    size_text,
    type_of_bits,
    wrong_depth,
)
from s2rtools.datasets.recording import SourceImage

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
DEPTH_ENCODINGS = ("16UC1", "mono16", "32FC1")
MAX_MILLIMETRES = 65534
_CONFIG = struct.Struct("<iff")


class _Samples(NamedTuple):
    """Samples of a raw image: numpy's type without byte order, channels, OpenCV's conversion."""

    kind: str
    channels: int
    to_rgb: int | None


_COLOURS = {
    "rgb8": _Samples("u1", 3, None),
    "bgr8": _Samples("u1", 3, cv2.COLOR_BGR2RGB),
    "rgba8": _Samples("u1", 4, cv2.COLOR_RGBA2RGB),
    "bgra8": _Samples("u1", 4, cv2.COLOR_BGRA2RGB),
    "mono8": _Samples("u1", 1, cv2.COLOR_GRAY2RGB),
    "8UC1": _Samples("u1", 1, cv2.COLOR_GRAY2RGB),
    "8UC3": _Samples("u1", 3, cv2.COLOR_BGR2RGB),
    "8UC4": _Samples("u1", 4, cv2.COLOR_BGRA2RGB),
    "rgb16": _Samples("u2", 3, None),
    "bgr16": _Samples("u2", 3, cv2.COLOR_BGR2RGB),
    "mono16": _Samples("u2", 1, cv2.COLOR_GRAY2RGB),
    "bayer_rggb8": _Samples("u1", 1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr8": _Samples("u1", 1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg8": _Samples("u1", 1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg8": _Samples("u1", 1, cv2.COLOR_BayerGRBG2RGB),
    "yuv422": _Samples("u1", 2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": _Samples("u1", 2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": _Samples("u1", 2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": _Samples("u1", 2, cv2.COLOR_YUV2RGB_YUY2),
}
_DEPTHS = {
    "16UC1": _Samples("u2", 1, None),
    "mono16": _Samples("u2", 1, None),
    "32FC1": _Samples("f4", 1, None),
    "8UC1": _Samples("u1", 1, None),
    "mono8": _Samples("u1", 1, None),
}


@dataclass(frozen=True, slots=True)
class Declared:
    """What a message says of its image; `size` is (0, 0) for one that is unreadable.

    Depth `in_metres` is converted to millimetres. `bits` are those of a sample of depth.
    """

    size: tuple[int, int]
    is_depth: bool
    in_metres: bool = False
    bits: int = 16


def declared(message: Any) -> Declared:
    """Size (height, width) of a message's image, and whether its encoding is one of depth."""
    if hasattr(message, "encoding"):
        size = int(message.height), int(message.width)
        is_depth = message.encoding in DEPTH_ENCODINGS
        readable = size[0] * size[1] <= MAX_PIXELS
        in_metres, bits = message.encoding == "32FC1", 8 if "8" in message.encoding else 16
        return Declared(size if readable else (0, 0), is_depth, in_metres, bits)
    is_depth = "compressedDepth" in message.format
    try:
        header = read_header(_encoded(message))
    except ValueError:
        return Declared((0, 0), is_depth, _is_inverse(message))
    is_depth |= header.bits == 16 and header.channels == 1
    size = header.size if header.pixels <= MAX_PIXELS else (0, 0)
    is_inverse = _is_inverse(message)
    return Declared(size, is_depth, is_inverse, 16 if is_inverse else header.bits)


def checksum(message: Any) -> str:
    """SHA-256 of the image data of a ROS message."""
    return hashlib.sha256(message.data.tobytes()).hexdigest()


def decode_rgb(message: Any, name: str, size: tuple[int, int]) -> SourceImage | InputIssue:
    """The RGB image (H, W, 3) uint8 of a message, or an issue if it is not of (height, width).

    Colours of 16 bits keep their upper 8, and Bayer patterns are interpolated.
    """
    if not hasattr(message, "encoding"):
        mode = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
        return _image(message, decode_image(message.data.tobytes(), name, mode, size))
    if (wrong := _wrong_size(message, name, size)) is not None:
        return wrong
    samples = _COLOURS.get(message.encoding)
    if samples is None:
        detail = f"encoding {message.encoding[:40]!r} is not read"
        return InputIssue("unreadable image", name, detail)
    try:
        pixels = _raw(message, samples)
        bits = 8 * pixels.itemsize
        if bits == 16:
            pixels = (pixels >> 8).astype(np.uint8)
        if samples.to_rgb is not None:
            pixels = cv2.cvtColor(pixels, samples.to_rgb)
    except (ValueError, cv2.error) as error:
        reason = "it cannot be converted" if isinstance(error, cv2.error) else str(error)
        return InputIssue("unreadable image", name, reason)
    return _image(message, (pixels, bits))


def decode_depth(message: Any, name: str, size: tuple[int, int]) -> SourceImage | InputIssue:
    """The depth image (H, W) uint8 or uint16 of a message, or an issue as in `decode_rgb`."""
    if hasattr(message, "encoding"):
        if (wrong := _wrong_size(message, name, size)) is not None:
            return wrong
        samples = _DEPTHS.get(message.encoding)
        if samples is None:
            detail = f"encoding {message.encoding[:40]!r}, expected {', '.join(DEPTH_ENCODINGS)}"
            return InputIssue("not a depth image", name, detail)
        try:
            pixels = _raw(message, samples)
        except ValueError as error:
            return InputIssue("unreadable image", name, str(error))
        bits = 8 * pixels.itemsize
        return _image(message, (millimetres(pixels) if bits == 32 else pixels, bits))
    if "rvl" in message.format.lower():
        return InputIssue("unreadable image", name, f"{message.format}: PNG is read, RVL is not")
    decoded = decode_image(_encoded(message), name, cv2.IMREAD_UNCHANGED, size)
    if isinstance(decoded, InputIssue):
        return decoded
    pixels, bits = decoded
    if (wrong := wrong_depth(pixels, name)) is not None:
        return wrong
    if _is_inverse(message):
        _, a, b = _CONFIG.unpack_from(message.data.tobytes())
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            metres = np.where(pixels > 0, np.float32(a) / (pixels - np.float32(b)), np.nan)
        return _image(message, (millimetres(metres), 32))
    return _image(message, (pixels, bits))


def millimetres(metres: NDArray[np.floating[Any]]) -> NDArray[np.uint16]:
    """Depth in whole millimetres, 0 where it is not finite, not positive or out of range."""
    with np.errstate(invalid="ignore", over="ignore"):
        rounded = np.rint(metres.astype(np.float64) * 1000)
        valid = np.isfinite(rounded) & (rounded > 0) & (rounded <= MAX_MILLIMETRES)
    return np.where(valid, rounded, 0).astype(np.uint16)


def _image(
    message: Any, decoded: tuple[NDArray[Any], int] | InputIssue
) -> SourceImage | InputIssue:
    if isinstance(decoded, InputIssue):
        return decoded
    return SourceImage(np.ascontiguousarray(decoded[0]), checksum(message), decoded[1])


def _is_inverse(message: Any) -> bool:
    return "compressedDepth" in message.format and message.format.lstrip().startswith("32FC1")


def _encoded(message: Any) -> bytes:
    """The encoded image of a CompressedImage, without the header of `compressedDepth`."""
    content: bytes = message.data.tobytes()
    return content[_CONFIG.size :] if "compressedDepth" in message.format else content


def _wrong_size(message: Any, name: str, size: tuple[int, int]) -> InputIssue | None:
    found = int(message.height), int(message.width)
    if found == size:
        return None
    return InputIssue("wrong size", name, f"{size_text(found)}, expected {size_text(size)}")


def _raw(message: Any, samples: _Samples) -> NDArray[Any]:
    """Samples (H, W) or (H, W, C) of a raw image. Raises ValueError."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    dtype = np.dtype((">" if message.is_bigendian else "<") + samples.kind)
    row = width * samples.channels * dtype.itemsize
    if not 0 < height * width <= MAX_PIXELS:
        raise ValueError(f"{width}x{height} pixels; 1 to {MAX_PIXELS:,} are read")
    if step < row or len(message.data) != height * step:
        raise ValueError(
            f"{len(message.data)} bytes with step {step}, but {width}x{height} pixels of "
            f"{message.encoding} need {height} rows of {row} bytes"
        )
    rows = np.frombuffer(message.data.tobytes(), np.uint8).reshape(height, step)[:, :row]
    pixels = np.ascontiguousarray(rows).view(dtype).astype(dtype.newbyteorder("="))
    return pixels if samples.channels == 1 else pixels.reshape(height, width, samples.channels)


class ImageIndex:
    """Recording time, stamp, size and bits of each image of a topic; 40 bytes each.

    Times are those of the headers, or those of the recording where all headers have 0.
    """

    def __init__(self, bag: BagMessages, topic: str) -> None:
        self.bag, self.topic = bag, topic
        self.frames: set[str] = set()
        self.in_metres = False
        self._rows = array("q")
        self.times: NDArray[np.int64] = np.zeros(0, np.int64)
        """Nanoseconds, ascending; empty before `finish`."""
        self.issues: list[InputIssue] = []

    def add(self, recorded: int, message: Any) -> None:
        found = declared(message)
        self.in_metres |= found.in_metres
        self._rows.extend((recorded, stamp_of(message), *found.size, found.bits))
        self.frames.add(frame_name(message.header.frame_id))

    def finish(self) -> None:
        """Sort by time; images with the time of another are left out and reported."""
        table = np.frombuffer(self._rows, dtype=np.int64).reshape(-1, 5)
        has_stamps = bool(table[:, 1].any())
        times = table[:, 1 if has_stamps else 0]
        late = int((np.diff(times) < 0).sum())
        if late:
            detail = f"{late} of {len(times)} before the one in front of them; sorted"
            self.issues.append(InputIssue("unordered stamps", self._place, detail))
        self.times, first = np.unique(times, return_index=True)
        if len(first) < len(times):
            again = counted(len(times) - len(first), "image")
            detail = f"left out: {again} with the stamp of another"
            self.issues.append(InputIssue("repeated stamps", self._place, detail))
        self._table = table[first]
        self._rows = array("q")

    def common_size(self) -> tuple[int, int]:
        """The (height, width) of most images. Raises RequestError if all are unreadable."""
        sizes, counts = np.unique(self._table[:, 2:4], axis=0, return_counts=True)
        readable = sizes.all(axis=1)
        if not readable.any():
            raise RequestError(f"{self.bag.path}: topic {self.topic}: no image can be decoded")
        height, width = sizes[np.argmax(np.where(readable, counts, 0))].tolist()
        return height, width

    def image(self, row: int, is_depth: bool, size: tuple[int, int]) -> BagImage:
        """The image of a row, whose (height, width) must be `size`."""
        recorded, stamp, height, width, bits = self._table[row].tolist()
        name = self.name(row)
        return BagImage(self, recorded, stamp, name, height * width, is_depth, size, bits)

    def name(self, row: int) -> str:
        return f"{self._place}:{self.times[row]}"

    @property
    def _place(self) -> str:
        return f"{self.bag.path.name}:{self.topic}"


@dataclass(frozen=True, slots=True)
class BagImage:
    """An image of a bag that has not been decoded; see `recording.RecordedImage`."""

    index: ImageIndex
    recorded: int
    stamp: int
    name: str
    pixels: int
    is_depth: bool
    size: tuple[int, int]
    bits: int

    @property
    def declared_type(self) -> str:
        return type_of_bits(self.bits)

    @property
    def files(self) -> tuple[Path, ...]:
        return (self.index.bag.path,)

    def checksum(self) -> str | None:
        try:
            with refusing_damage(self.index.bag.path):
                return checksum(self._message())
        except RequestError:
            return None

    def read(self) -> SourceImage | InputIssue:
        try:
            with refusing_damage(self.index.bag.path):
                decode = decode_depth if self.is_depth else decode_rgb
                return decode(self._message(), self.name, self.size)
        except RequestError as error:
            return InputIssue("unreadable image", self.name, str(error))

    def _message(self) -> Any:
        return self.index.bag.at(self.index.topic, self.recorded, self.stamp)
