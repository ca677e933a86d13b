"""Counterfactuals of image pairs for the rigs of a run, at a size that limits their cost."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from s2rstore.records import Domain, Intrinsics, Side
from s2rtools.common.frame_resizing import resized_depth
from s2rtools.counterfactual.counterfactual_inputs import (
    CounterfactualInputs,
    OwnView,
    composite_inputs,
    counterfactual_inputs,
)
from s2rtools.counterfactual.depth_tolerance import DepthTolerance
from s2rtools.counterfactual.scene_comparison import ImageArrays, RigPair
from s2rtools.counterfactual.view_synthesis import Frame
from s2rtools.models.input_contract import InputContract

MAX_SIDE = 192
"""Pixels on the longer side of the images that are compared."""


class PairImages(Protocol):
    """RGB (B, H, W, 3), raw depth (B, H, W) and its validity (B, H, W) of one side."""

    @property
    def rgb(self) -> NDArray[np.uint8]: ...
    @property
    def depth(self) -> NDArray[Any]: ...
    @property
    def valid(self) -> NDArray[np.bool_]: ...


class SideInput(PairImages, Protocol):
    """One side with the network's input x (B, C, h, w)."""

    @property
    def x(self) -> Tensor: ...


class PairCounterfactuals:
    """Makes counterfactuals of stored frames (height, width) of two rigs, the calibrated ones."""

    def __init__(self, sim: Domain, real: Domain, frame: Frame, tolerance: DepthTolerance) -> None:
        self._size = working_size(frame)
        self._scales: dict[Side, float] = {"sim": sim.depth_scale, "real": real.depth_scale}
        # A patch covers pixels in proportion to the square of the focal length.
        self._pixels = (real.rgb.fx * real.rgb.fy) / (sim.rgb.fx * sim.rgb.fy)
        self.rigs = RigPair(
            scaled_cameras(sim, frame, self._size), scaled_cameras(real, frame, self._size),
            self._size, tolerance,
        )  # fmt: skip

    def inputs(
        self, sim: PairImages, real: SideInput, contract: InputContract
    ) -> list[CounterfactualInputs]:
        """The counterfactual of each pair of a batch as inputs of a network."""
        registration, scale = self.rigs.real, self._scales["real"]
        made = []
        for number, (a, b) in enumerate(zip(self._resized(sim), self._resized(real), strict=True)):
            x = real.x[number].cpu().numpy()
            scenes = self.rigs.in_real_view(a, b)
            made.append(counterfactual_inputs(scenes, x, b[1], b[2], registration, scale, contract))
        return made

    def composites(
        self, sim: SideInput, real: SideInput, inputs: Sequence[CounterfactualInputs]
    ) -> Iterator[NDArray[np.float32]]:
        """The composites (32, C, h, w) of each pair of a batch, see `composite_inputs`.

        `inputs` are those of `inputs`.
        """
        images = zip(self._resized(sim), self._resized(real), strict=True)
        for number, (made, (a, b)) in enumerate(zip(inputs, images, strict=True)):
            views = (
                OwnView("sim", self.rigs.in_sim_view(a, b), self.rigs.sim, self._metres("sim", a)),
                OwnView("real", made.scenes, self.rigs.real, self._metres("real", b)),
            )
            sim_x = sim.x[number].cpu().numpy()
            yield composite_inputs(*views, sim_x, made.real, made.contract)

    def in_sim_view(
        self, sim: PairImages, maps: Sequence[NDArray[np.float32]]
    ) -> list[NDArray[np.float32]]:
        """Maps (n, rows, cols) over the real images of a batch, warped into the sim view.

        They keep their size, and about their sum over what both views show.
        """
        warped = []
        for values, images in zip(maps, self._resized(sim), strict=True):
            size, shape = self._size[::-1], values.shape[:0:-1]
            fine = np.stack([cv2.resize(v, size, interpolation=cv2.INTER_NEAREST) for v in values])
            found = self.rigs.to_sim_view(fine, images) * np.float32(self._pixels)
            warped.append(
                np.stack([cv2.resize(v, shape, interpolation=cv2.INTER_AREA) for v in found])
            )
        return warped

    def labels_in_real_view(
        self, labels: NDArray[Any], depth: NDArray[Any], valid: NDArray[np.bool_]
    ) -> NDArray[Any]:
        """Labels (H, W) of a sim image in the real view, at the working size; 0 if not seen.

        `depth` and `valid` (H, W) are those of the sim image.
        """
        images = resized_images(np.zeros((*depth.shape, 3), np.uint8), depth, valid, self._size)
        return self.rigs.labels_in_real_view(resized_depth(labels, self._size), images)

    def _metres(self, side: Side, images: ImageArrays) -> NDArray[np.float32]:
        """Depth (h, w) of a side's depth camera in metres, 0 where there is no value."""
        scale = self._scales[side]
        return np.where(images[2], images[1] * np.float32(scale), np.float32(0)).astype(np.float32)

    def _resized(self, images: PairImages) -> Iterator[ImageArrays]:
        for rgb, depth, valid in zip(images.rgb, images.depth, images.valid, strict=True):
            yield resized_images(rgb, depth, valid, self._size)


def working_size(frame: Frame) -> Frame:
    """The frame, reduced so that its longer side has at most `MAX_SIDE` pixels."""
    share = min(1.0, MAX_SIDE / max(frame))
    return max(8, round(frame[0] * share)), max(8, round(frame[1] * share))


def resized_images(
    rgb: NDArray[Any], depth: NDArray[Any], valid: NDArray[np.bool_], size: Frame
) -> ImageArrays:
    """Images of one view at another size: mean colours, nearest depth."""
    if depth.shape == size and rgb.shape[:2] == size:
        return rgb, depth, valid
    shape = size[1], size[0]
    return (
        np.asarray(cv2.resize(rgb, shape, interpolation=cv2.INTER_AREA)),
        np.asarray(cv2.resize(depth, shape, interpolation=cv2.INTER_NEAREST)),
        cv2.resize(valid.astype(np.uint8), shape, interpolation=cv2.INTER_NEAREST) > 0,
    )


def scaled_cameras(domain: Domain, frame: Frame, size: Frame) -> Domain:
    """The domain with its cameras for images of `size` instead of `frame`, (height, width)."""
    rows, cols = size[0] / frame[0], size[1] / frame[1]

    def scaled(lens: Intrinsics) -> Intrinsics:
        return replace(
            lens, fx=lens.fx * cols, cx=lens.cx * cols, fy=lens.fy * rows, cy=lens.cy * rows
        )

    return replace(domain, rgb=scaled(domain.rgb), depth=scaled(domain.depth))
