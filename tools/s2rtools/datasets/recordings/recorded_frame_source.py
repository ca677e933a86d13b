"""Frames of recordings as a data set stores them: checked, undistorted and resized."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain, Intrinsics
from s2rtools.common.frame_resizing import resized_depth, resized_rgb
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.image_decoding import size_text
from s2rtools.datasets.recording import PinholeCamera, RecordedFrame, RecordedImage, SourceImage
from s2rtools.datasets.scan import DecodedFrame, Scan, SourceImages


class CameraImages:
    """Checks the size of a camera's images and removes the distortion of its lens.

    An undistorted image has the camera's own focal lengths, principal point and size; what lies
    outside of the distorted image is 0, which is no valid depth.
    """

    def __init__(self, camera: PinholeCamera) -> None:
        self.camera = camera

    def intrinsics(self, frame: tuple[int, int], pitch: float) -> Intrinsics:
        """The intrinsics for frames of (height, width); `pitch` in radians."""
        camera = self.camera
        columns, rows = frame[1] / camera.width, frame[0] / camera.height
        return Intrinsics(
            camera.fx * columns, camera.fy * rows, camera.cx * columns, camera.cy * rows, pitch
        )

    def read(self, image: RecordedImage, interpolation: int) -> SourceImage | InputIssue:
        """The undistorted image; `interpolation` is that of OpenCV."""
        read = image.read()
        if isinstance(read, InputIssue):
            return read
        size = self.camera.height, self.camera.width
        if read.pixels.shape[:2] != size:
            detail = f"{size_text(read.pixels.shape)}, its camera has {size_text(size)}"
            return InputIssue("wrong size", image.name, detail)
        if self.camera.is_pinhole:
            return read
        pixels = cv2.remap(read.pixels, *self._maps, interpolation, borderMode=cv2.BORDER_CONSTANT)
        return replace(read, pixels=np.asarray(pixels))

    @cached_property
    def _maps(self) -> tuple[NDArray[Any], NDArray[Any]]:
        """Where each pixel of the undistorted image lies in the distorted one."""
        camera = self.camera
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
    """A `FrameSource` of one frame of a recording; `depth` is None in one without depth."""

    frame: RecordedFrame
    rgb: CameraImages
    depth: CameraImages | None

    @property
    def pixels(self) -> int:
        cameras = [each.camera for each in (self.rgb, self.depth) if each is not None]
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
        cameras = self.rgb.camera, self.depth and self.depth.camera
        depth = self.frame.depth
        return files, ascii((self.frame.rgb.name, depth and depth.name, cameras))

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
        rgb = self.rgb.read(self.frame.rgb, cv2.INTER_LINEAR)
        if isinstance(rgb, InputIssue):
            return rgb
        issues = []
        if rgb.bits > 8:
            detail = f"{rgb.bits} bits; stored with 8"
            issues.append(InputIssue("colours of more than 8 bits", self.frame.rgb.name, detail))
        depth = self._read_depth()
        if isinstance(depth, InputIssue):
            return depth
        colours, raw = rgb.pixels, None if depth is None else depth.pixels
        sizes = {image.shape[:2] for image in (colours, raw) if image is not None}
        source = None if sizes == {scan.frame} else SourceImages(colours, raw)
        if source is not None and not source.is_storable:
            source, detail = None, f"{size_text(colours.shape)}; networks see the stored frame"
            issues.append(InputIssue("image too large to be kept", self.frame.rgb.name, detail))
        small, is_valid = resized_rgb(colours, scan.frame), np.array(np.nan)
        digest = rgb.sha256
        if depth is not None and raw is not None:
            digest, raw = _joined(rgb.sha256, depth.sha256), resized_depth(raw, scan.frame)
            is_valid = (raw >= domain.depth_raw_min) & (raw <= domain.depth_raw_max)
        return DecodedFrame(small, raw, digest, float(is_valid.mean()), tuple(issues), source)

    def _read_depth(self) -> SourceImage | InputIssue | None:
        if self.depth is None:
            return None
        if self.frame.depth is None:
            return InputIssue("missing depth", self.frame.rgb.name, "other frames have depth")
        image = self.depth.read(self.frame.depth, cv2.INTER_NEAREST)
        if isinstance(image, InputIssue):
            return image
        if image.pixels.ndim != 2 or image.pixels.dtype not in (np.uint8, np.uint16):
            found = f"{image.pixels.dtype} {image.pixels.shape}"
            return InputIssue("not a depth image", self.frame.depth.name, found)
        return image


def _joined(rgb: str, depth: str) -> str:
    """The checksum of a frame of two images: SHA-256 over their hexadecimal SHA-256."""
    return hashlib.sha256((rgb + depth).encode()).hexdigest()
