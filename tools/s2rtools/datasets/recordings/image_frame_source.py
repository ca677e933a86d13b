"""Images as the frames that a data set stores: checked, undistorted and resized."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain, Side
from s2rtools.common.input_issue import InputIssue
from s2rtools.datasets.files.image_decoding import depth_of, is_photo, made_frame, size_text
from s2rtools.datasets.recording import PinholeCamera, RecordedFrame, RecordedImage, SourceImage
from s2rtools.datasets.recordings.recorded_files import ImageFile
from s2rtools.datasets.scan import DecodedFrame, Scan


def read_undistorted(
    image: RecordedImage, camera: PinholeCamera | None, interpolation: int
) -> SourceImage | InputIssue:
    """An image without the distortion of the camera's lens; `interpolation` is that of OpenCV.

    Without a camera it is the image as it is. It has the camera's own focal lengths, principal
    point and size; what lies outside of the distorted image is 0, which is no valid depth. Images
    of another size are an InputIssue.
    """
    read = image.read()
    if isinstance(read, InputIssue) or camera is None:
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
class ImageFrameSource:
    """A `FrameSource` of the images of one instant.

    Images are undistorted where their camera is given. Issues name the `side`, if it is given.
    """

    frame: RecordedFrame
    rgb_camera: PinholeCamera | None = None
    depth_camera: PinholeCamera | None = None
    side: Side | None = None

    @property
    def images(self) -> list[tuple[RecordedImage, PinholeCamera | None]]:
        """The images and their cameras, RGB first."""
        images = [(self.frame.rgb, self.rgb_camera)]
        if self.frame.depth is not None:
            images.append((self.frame.depth, self.depth_camera))
        return images

    @property
    def pixels(self) -> int:
        return max(
            image.pixels if camera is None else camera.width * camera.height
            for image, camera in self.images
        )

    def file_names(self, scan: Scan) -> tuple[str | None, str | None]:
        depth = self.frame.depth
        return self.frame.rgb.name, None if depth is None else depth.name

    @property
    def files(self) -> list[Path]:
        """The files that the images are read from, as far as they state them."""
        return [path for image, _ in self.images for path in getattr(image, "files", ())]

    def origin(self) -> tuple[list[Path], str] | None:
        """See `TracedSource`; None where a layout's images do not state their `files`."""
        if not all(hasattr(image, "files") for image, _ in self.images):
            return None
        facts = [(each.name, getattr(each, "size", None), camera) for each, camera in self.images]
        return self.files, ascii(facts)

    def declared_depth_type(self) -> str | None:
        """The numpy type of the depth image by its header; None without one."""
        return getattr(self.frame.depth, "declared_type", None)

    def checksum(self, scan: Scan, domain: Domain) -> str | None:
        sums = [image.checksum() for image, _ in self.images]
        return _joined([each for each in sums if each is not None]) if all(sums) else None

    def decode(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        """Read both images, undistort and resize them; an InputIssue names a bad one.

        Depth takes the nearest pixel in both steps, so that every value occurs in the source.
        """
        frame = self._decode(scan, domain)
        if self.side is None:
            return frame
        if isinstance(frame, InputIssue):
            return frame.of_side(self.side)
        return replace(frame, issues=tuple(each.of_side(self.side) for each in frame.issues))

    def _decode(self, scan: Scan, domain: Domain) -> DecodedFrame | InputIssue:
        rgb, depth = self.frame.rgb, self.frame.depth
        colours = read_undistorted(rgb, self.rgb_camera, cv2.INTER_LINEAR)
        if isinstance(colours, InputIssue):
            return colours
        raw: NDArray[Any] | None = None
        sums = [colours.sha256]
        if depth is not None:
            read = read_undistorted(depth, self.depth_camera, cv2.INTER_NEAREST)
            if isinstance(read, InputIssue):
                return read
            one_channel = depth_of(read.pixels, depth.name)
            if isinstance(one_channel, InputIssue):
                return one_channel
            raw = one_channel
            sums.append(read.sha256)
        elif domain.has_depth:
            return InputIssue("missing depth", rgb.name, "other frames have depth")
        pixels = colours.pixels, colours.bits
        frame = made_frame(scan, domain, pixels, raw, _joined(sums), rgb.name)
        if depth is not None and frame.depth is not None and is_photo(frame.depth, frame.rgb):
            return InputIssue("not a depth image", depth.name, "it repeats the RGB image")
        return frame


def source_of_files(
    root: Path, rgb: str, depth: str, sizes: tuple[tuple[int, int], tuple[int, int]]
) -> ImageFrameSource:
    """Make a frame source of an RGB and a depth file in the folder `root`.

    sizes: the (height, width) that each file must have.
    """
    of_rgb, of_depth = sizes
    return ImageFrameSource(
        RecordedFrame(
            ImageFile(root / rgb, rgb, of_rgb), ImageFile(root / depth, depth, of_depth, True)
        )
    )


def _joined(sums: Sequence[str]) -> str:
    """The checksum of a frame: SHA-256 over the hexadecimal ones of its images, or the only one."""
    return sums[0] if len(sums) == 1 else hashlib.sha256("".join(sums).encode()).hexdigest()
