"""Frames of recordings as a data set stores them: checked, undistorted and resized."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.image_decoding import made_frame, size_text, wrong_depth
from s2rtools.datasets.recording import PinholeCamera, RecordedFrame, RecordedImage, SourceImage
from s2rtools.datasets.scan import DecodedFrame, Scan


def read_undistorted(
    image: RecordedImage, camera: PinholeCamera, interpolation: int
) -> SourceImage | InputIssue:
    """An image without the distortion of the camera's lens; `interpolation` is that of OpenCV.

    It has the camera's own focal lengths, principal point and size; what lies outside of the
    distorted image is 0, which is no valid depth. Images of another size are an InputIssue.
    """
    read = image.read()
    if isinstance(read, InputIssue):
        return read
    size = camera.height, camera.width
    if read.pixels.shape[:2] != size:
        detail = f"{size_text(read.pixels.shape)}, its camera has {size_text(size)}"
        return InputIssue("wrong size", image.name, detail)
    if camera.is_pinhole:
        return read
    maps = _undistortion(camera)
    pixels = cv2.remap(read.pixels, *maps, interpolation, borderMode=cv2.BORDER_CONSTANT)
    return replace(read, pixels=np.asarray(pixels))


@lru_cache(maxsize=4)
def _undistortion(camera: PinholeCamera) -> tuple[NDArray[Any], NDArray[Any]]:
    """Where each pixel of the undistorted image lies in the distorted one."""
    matrix = np.array(
        [[camera.fx, 0, camera.cx - 0.5], [0, camera.fy, camera.cy - 0.5], [0, 0, 1]]
    )  # OpenCV places the centre of pixel i at i
    size = camera.width, camera.height
    make = cv2.fisheye if camera.is_fisheye else cv2
    maps = make.initUndistortRectifyMap(
        matrix, camera.coefficients, np.eye(3), matrix, size, cv2.CV_32FC1
    )
    return maps[0], maps[1]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedFrameSource:
    """A `FrameSource` of one frame of a recording.

    `rgb` and `depth` are the cameras; `depth` is None in a recording without depth.
    """

    frame: RecordedFrame
    rgb: PinholeCamera
    depth: PinholeCamera | None

    @property
    def pixels(self) -> int:
        cameras = [each for each in (self.rgb, self.depth) if each is not None]
        return max(camera.width * camera.height for camera in cameras)

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        depth = self.frame.depth
        return self.frame.rgb.name, None if depth is None or self.depth is None else depth.name

    def origin(self) -> tuple[list[Path], str] | None:
        """See `TracedSource`; None where a layout's images do not state their `files`."""
        files: list[Path] = []
        for image in (self.frame.rgb, self.frame.depth):
            if image is not None:
                if (of_image := getattr(image, "files", None)) is None:
                    return None
                files += of_image
        depth = self.frame.depth
        facts = self.frame.rgb.name, depth and depth.name, (self.rgb, self.depth)
        return files, ascii(facts)

    def declared_depth_type(self) -> str | None:
        return getattr(self.frame.depth, "declared_type", None)

    def checksum(self, scan: Scan, domain: Domain) -> str | None:
        rgb = self.frame.rgb.checksum()
        if rgb is None or self.depth is None:
            return rgb
        depth = None if self.frame.depth is None else self.frame.depth.checksum()
        return None if depth is None else _joined(rgb, depth)

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        """Read both images, undistort and resize them; an InputIssue names the unusable one.

        Depth takes the nearest pixel in both steps, so that every value occurs in the source.
        Issues name the domain, which is the side of the recording.
        """
        frame = self._decode(scan, domain)
        if isinstance(frame, InputIssue):
            return frame.of_side(domain.domain)
        return replace(frame, issues=tuple(each.of_side(domain.domain) for each in frame.issues))

    def _decode(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        rgb = read_undistorted(self.frame.rgb, self.rgb, cv2.INTER_LINEAR)
        if isinstance(rgb, InputIssue):
            return rgb
        depth = self._read_depth()
        if isinstance(depth, InputIssue):
            return depth
        digest = rgb.sha256 if depth is None else _joined(rgb.sha256, depth.sha256)
        raw = None if depth is None else depth.pixels
        colours = rgb.pixels, rgb.bits
        return made_frame(scan, domain, colours, raw, digest, self.frame.rgb.name)

    def _read_depth(self) -> SourceImage | InputIssue | None:
        if self.depth is None:
            return None
        if self.frame.depth is None:
            return InputIssue("missing depth", self.frame.rgb.name, "other frames have depth")
        image = read_undistorted(self.frame.depth, self.depth, cv2.INTER_NEAREST)
        if isinstance(image, InputIssue):
            return image
        return wrong_depth(image.pixels, self.frame.depth.name) or image


def _joined(rgb: str, depth: str) -> str:
    """The checksum of a frame of two images: SHA-256 over their hexadecimal SHA-256."""
    return hashlib.sha256((rgb + depth).encode()).hexdigest()
