"""Decoding one view: both files checked, brought to the stored size, validity counted."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain
from s2rtools.ingest.scan import Problem, Scan, View

_COLOUR_SPREAD = 8
_PHOTO_DIFFERENCE = 6.0
_PHOTO_CORRELATION = 0.98


@dataclass(frozen=True, slots=True)
class Images:
    """The two source files of one view, and the (height, width) that each must have."""

    rgb: Path
    depth: Path
    rgb_size: tuple[int, int]
    depth_size: tuple[int, int]

    def files(self, scan: Scan) -> tuple[str | None, str | None]:
        return scan.relative(self.rgb), scan.relative(self.depth)

    def depth_type(self, scan: Scan, domain: Domain) -> str | Problem:
        found = self.view(scan, domain)
        return found if isinstance(found, Problem) else str(found.depth.dtype)

    def view(self, scan: Scan, domain: Domain) -> View | Problem:
        return decode(scan, domain, self)


def decode(scan: Scan, domain: Domain, images: Images) -> View | Problem:
    """Read, check and resize one view; a Problem names the file that cannot be used.

    RGB is averaged over areas. Depth takes the nearest source pixel, so that every stored value
    is one of the file and validity needs no second mask.
    """
    digest = hashlib.sha256()
    rgb = _read(scan, images.rgb, cv2.IMREAD_COLOR_RGB, digest)
    if isinstance(rgb, Problem):
        return rgb
    depth = _read(scan, images.depth, cv2.IMREAD_UNCHANGED, digest)
    if isinstance(depth, Problem):
        return depth
    name = scan.relative(images.depth)
    if depth.ndim == 3:
        if int(np.ptp(depth[..., :3].astype(np.int16), axis=2).max()) > _COLOUR_SPREAD:
            return Problem("not a depth image", name, "it has colours")
        depth = depth[..., 0]
    if depth.dtype not in (np.uint8, np.uint16):
        return Problem("not a depth image", name, f"type {depth.dtype}")
    expected = ((images.rgb, rgb, images.rgb_size), (images.depth, depth, images.depth_size))
    for path, image, size in expected:
        if image.shape[:2] != size:
            detail = f"{size_text(image.shape)}, expected {size_text(size)}"
            return Problem("wrong size", scan.relative(path), detail)
    height, width = scan.frame
    rgb = _resized_rgb(rgb, (width, height))
    depth = cv2.resize(depth, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    if _is_photo(depth, rgb):
        return Problem("not a depth image", name, "it repeats the RGB image")
    valid = (depth >= domain.depth_raw_min) & (depth <= domain.depth_raw_max)
    return View(rgb, depth, digest.hexdigest(), float(valid.mean()))


def _read(scan: Scan, path: Path, mode: int, digest: Any) -> NDArray[Any] | Problem:
    name = scan.relative(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        return Problem("unreadable image", name, str(error.strerror))
    digest.update(content)
    if not content:
        return Problem("unreadable image", name, "empty file")
    if truncated(content):
        return Problem("truncated image", name)
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), mode)
    except cv2.error:
        image = None
    if image is None:
        return Problem("unreadable image", name, "no picture that can be decoded")
    return np.asarray(image)


def truncated(content: bytes) -> bool:
    """Whether a JPEG or PNG stops before its end marker; decoders often fill the rest with grey."""
    if content[:2] == b"\xff\xd8":
        return b"\xff\xd9" not in content[-64:]
    if content[:8] == b"\x89PNG\r\n\x1a\n":
        return b"IEND" not in content[-64:]
    return False


def _resized_rgb(rgb: NDArray[Any], size: tuple[int, int]) -> NDArray[np.uint8]:
    shrinks = rgb.shape[1] >= size[0] and rgb.shape[0] >= size[1]
    mode = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(rgb, size, interpolation=mode), dtype=np.uint8)


def _is_photo(depth: NDArray[Any], rgb: NDArray[np.uint8]) -> bool:
    """Whether an 8-bit depth image is the grey version of the RGB image."""
    if depth.dtype != np.uint8:
        return False
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    if float(cv2.absdiff(grey, depth).mean()) >= _PHOTO_DIFFERENCE or not depth.any():
        return False
    with np.errstate(invalid="ignore"):
        return bool(np.corrcoef(grey.ravel(), depth.ravel())[0, 1] > _PHOTO_CORRELATION)


def stored_size(path: Path) -> tuple[int, int] | None:
    """(height, width) of an image file; None where it cannot be decoded."""
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return None if image is None else (image.shape[0], image.shape[1])


def size_text(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
