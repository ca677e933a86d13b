"""Images of LeRobot data sets of versions 2 and 3, in videos or in Parquet.

Source: the documentation of LeRobotDataset. Depth is a feature of its own: a video of 12-bit codes,
whose range the feature states, or of millimetres; or images of millimetres or metres.
"""

from __future__ import annotations

import hashlib
import os
import threading
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.index.parquet_table import read_blobs
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.image_decoding import decode_image
from s2rtools.datasets.files.path_containment import PathContainment
from s2rtools.datasets.recording import SourceImage
from s2rtools.datasets.recordings.lerobot_files import LAST_CODE, Episode, FrameNumbers, Info
from s2rtools.datasets.recordings.video_images import ImageStore, ImageStream, VideoImages

_BLOCK = 64
"""Images that are read from Parquet at once."""


@dataclass(frozen=True, slots=True)
class FeatureImages:
    """The images of a feature, all of one size (height, width)."""

    key: str
    images: ImageStore
    size: tuple[int, int]

    @classmethod
    def of(
        cls, containment: PathContainment, info: Info, key: str, episode: Episode,
        data: FrameNumbers,
    ) -> FeatureImages:  # fmt: skip
        """The images of a feature, of the size of the first one of an episode.

        Raises RequestError if that cannot be decoded, or if the range of depth is not usable.
        """
        images = _image_store(containment, key, info)
        file, numbers = episode.place(key, data, data.rows(episode))
        image = images.read(file, int(numbers[0]))
        if isinstance(image, InputIssue):
            advice, feature = "", info.features[key]
            if feature.dtype == "video" and os.path.isfile(containment.folder / file):
                codec = feature.codec
                advice = f"; the videos are in {codec}, convert them to H.264: ffmpeg -c:v libx264"
            raise RequestError(f"{image.file}: {image.kind} ({image.detail}){advice}")
        height, width = image.pixels.shape[:2]
        return cls(key, images, (height, width))

    def stream(self, episode: Episode, data: FrameNumbers, rows: NDArray[np.intp]) -> ImageStream:
        """The images of rows of an episode."""
        return ImageStream(self.images, *episode.place(self.key, data, rows), self.size)


class ParquetImages:
    """Encoded images in a column of records with the fields `bytes` and `path`.

    `mode` is that of OpenCV's `imdecode`.
    """

    def __init__(self, containment: PathContainment, column: str, mode: int) -> None:
        self._containment, self._column, self._mode = containment, column, mode
        self._lock = threading.Lock()
        self._key: tuple[str, int] = ("", -1)
        self._block: list[bytes] = []

    def read(self, file: str, number: int) -> SourceImage | InputIssue:
        name = f"{file}:{number}"
        try:
            content = self._content(file, number)
        except RequestError as error:
            return InputIssue("unreadable image", name, str(error))
        decoded = decode_image(content, name, self._mode)
        if isinstance(decoded, InputIssue):
            return decoded
        return SourceImage(decoded[0], hashlib.sha256(content).hexdigest(), decoded[1])

    def path(self, file: str) -> Path:
        """The path of a file of the data set."""
        return self._containment.folder / file

    def _content(self, file: str, number: int) -> bytes:
        key = file, number // _BLOCK
        with self._lock:
            if key != self._key:
                path = self._containment.resolve(file, str(self._containment.folder))
                start = key[1] * _BLOCK
                self._block = read_blobs(path, self._column, "bytes", start, _BLOCK)
                self._key = key
            row = number % _BLOCK
            return self._block[row] if row < len(self._block) else b""


class DepthImages:
    """Depth images (H, W) uint16 in millimetres, 0 where there is none.

    They are those of another store: 12-bit codes with the millimetres of each in `table`, integers
    in millimetres, or floating-point numbers in metres.
    """

    def __init__(self, images: ImageStore, table: NDArray[np.uint16] | None) -> None:
        self._images, self._table = images, table

    def read(self, file: str, number: int) -> SourceImage | InputIssue:
        image = self._images.read(file, number)
        if isinstance(image, InputIssue):
            return image
        pixels = image.pixels
        if pixels.ndim == 3:
            return InputIssue("no depth image", f"{file}:{number}", "colours, not one channel")
        if pixels.dtype.kind == "f":
            metres = np.nan_to_num(pixels, posinf=0.0, neginf=0.0)
            pixels = np.clip(np.rint(1000 * metres), 0, np.iinfo(np.uint16).max).astype(np.uint16)
        elif self._table is not None and pixels.ndim == 2:
            pixels = self._table[np.minimum(pixels, LAST_CODE)]
        return replace(image, pixels=pixels)

    def path(self, file: str) -> Path:
        """The path of a file of the data set."""
        return self._images.path(file)


def _image_store(containment: PathContainment, key: str, info: Info) -> ImageStore:
    """The images of a feature `key`, which are in videos or in Parquet.

    Raises RequestError where the range of depth is not usable.
    """
    feature = info.features[key]
    colour = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    mode = cv2.IMREAD_UNCHANGED if feature.is_depth else colour
    images: ImageStore = (
        VideoImages(containment, feature.codec)
        if feature.dtype == "video"
        else ParquetImages(containment, key, mode)
    )
    if not feature.is_depth:
        return images
    return DepthImages(images, feature.millimetres(key, containment.folder))
