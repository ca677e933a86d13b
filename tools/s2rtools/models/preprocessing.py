"""Convert frames to a network's input, as its contract states."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn import functional

from s2rtools.models.input_contract import InputContract, Interpolation

_OPENCV: dict[Interpolation, int] = {
    "nearest": cv2.INTER_NEAREST,
    "nearest-exact": cv2.INTER_NEAREST_EXACT,
    "bilinear": cv2.INTER_LINEAR,
    "bicubic": cv2.INTER_CUBIC,
    "area": cv2.INTER_AREA,
}
_ANTIALIAS = "-antialias"
_ROUNDING = 1e-6
"""Weight of missing pixels from which an interpolated pixel is missing."""


def preprocess(
    rgb: NDArray[Any],
    depth: NDArray[Any],
    depth_scale: float,
    contract: InputContract,
    valid: NDArray[np.bool_] | None = None,
) -> NDArray[np.float32]:
    """rgb (B, H, W, 3), raw depth (B, H', W') and its validity -> the input x (B, C, h, w).

    RGB has levels 0 .. 255; metres = raw * `depth_scale`. Without `valid`, no depth is missing.
    """
    x = np.empty((len(rgb), *contract.shape), dtype=np.float32)
    if contract.has_rgb:
        _fill_colours(x[:, :3], resize(rgb, contract.size, contract.rgb_interpolation), contract)
    if contract.has_depth:
        _fill_depth(x[:, -1], depth, depth_scale, contract, valid)
    return x


def _fill_colours(x: NDArray[np.float32], rgb: NDArray[np.uint8], contract: InputContract) -> None:
    planes = np.moveaxis(rgb, -1, 1)
    mean, std = contract.mean, contract.std
    if contract.colour_order == "bgr":
        planes, mean, std = planes[:, ::-1], mean[::-1], std[::-1]
    factors = np.array([contract.rgb_scale / (255 * each) for each in std], dtype=np.float32)
    offsets = np.array([-m / s for m, s in zip(mean, std, strict=True)], dtype=np.float32)
    np.multiply(planes, factors[:, None, None], out=x, dtype=np.float32)
    x += offsets[:, None, None]


def _fill_depth(
    x: NDArray[np.float32],
    depth: NDArray[Any],
    depth_scale: float,
    contract: InputContract,
    valid: NDArray[np.bool_] | None,
) -> None:
    how, unit = contract.depth_interpolation, contract.depth_unit * contract.depth_std
    np.multiply(
        resize(depth, contract.size, how), np.float32(depth_scale / unit), out=x, dtype=np.float32
    )
    low, high = (np.float32(limit / unit) for limit in contract.depth_range)
    np.clip(x, low, high, out=x)
    if contract.missing_depth is not None and valid is not None:
        missing = resize((~valid).astype(np.float32), contract.size, how)
        x[np.abs(missing) > _ROUNDING] = contract.missing_depth / unit
    x -= np.float32(contract.depth_mean / contract.depth_std)


def resize(
    images: NDArray[Any], size: tuple[int, int], interpolation: Interpolation
) -> NDArray[Any]:
    """Resize a batch (B, H, W, ...) to (h, w) in its own type; images of that size stay as is."""
    if images.shape[1:3] == size:
        return images
    if interpolation.endswith(_ANTIALIAS):
        return _resize_antialiased(images, size, interpolation.removesuffix(_ANTIALIAS))
    height, width = size
    out = np.empty((len(images), height, width, *images.shape[3:]), dtype=images.dtype)
    grows = images.shape[1] < height or images.shape[2] < width
    method = _OPENCV["bilinear" if grows and interpolation == "area" else interpolation]
    for source, target in zip(images, out, strict=True):
        cv2.resize(np.ascontiguousarray(source), (width, height), dst=target, interpolation=method)
    return out


def _resize_antialiased(images: NDArray[Any], size: tuple[int, int], mode: str) -> NDArray[Any]:
    """Resize by filters that are as wide as the area of an output pixel, as torchvision does."""
    planes = images[:, None] if images.ndim == 3 else np.moveaxis(images, -1, 1)
    x = torch.from_numpy(np.ascontiguousarray(planes, dtype=np.float32))
    small = functional.interpolate(x, size, mode=mode, align_corners=False, antialias=True).numpy()
    if images.dtype.kind == "u":
        small = np.clip(np.rint(small), 0, np.iinfo(images.dtype).max)
    small = small[:, 0] if images.ndim == 3 else np.moveaxis(small, 1, -1)
    return np.ascontiguousarray(small, dtype=images.dtype)
