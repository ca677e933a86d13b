"""Harmonisation: warp the real image into the sim camera's view and match its colours.

The warp is depth-image-based rendering by the sim depth. The colour transfer follows Reinhard et
al. (2001), per channel of the image.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.errors import RequestError
from s2rstore.geometry.camera import into_rgb
from s2rstore.geometry.camera_offset import RigOffset
from s2rstore.geometry.reprojection import Reprojection
from s2rstore.records import Domain
from s2rtools.counterfactual.depth_tolerance import DepthTolerance
from s2rtools.counterfactual.pair_counterfactuals import PairCounterfactuals

COLOUR_FLOOR = 5.0
"""Grey levels added to both deviations, so that noise of flat images is not amplified."""

ViewImages = tuple[NDArray[np.uint8], NDArray[Any], NDArray[np.bool_]]
"""RGB (H, W, 3), raw depth (H, W) and its validity (H, W) of one view."""


@dataclass(frozen=True, slots=True, eq=False)
class HarmonisedPair:
    """One pair in the view of the sim RGB camera.

    `sim` and `real` (h, w, 3) float32 0 .. 255, the real colours matched; `sim_depth` and
    `real_depth` (h, w) float32 metres, 0 where the sim depth is unknown; `visible` in the real
    camera's view, `measured` where its depth is valid too. Elsewhere real repeats sim.
    """

    sim: NDArray[np.float32]
    real: NDArray[np.float32]
    sim_depth: NDArray[np.float32]
    real_depth: NDArray[np.float32]
    visible: NDArray[np.bool_]
    measured: NDArray[np.bool_]


class CameraView:
    """The RGB pixels of one rig, located in space by its depth and reprojected to the other rig."""

    def __init__(self, view: Domain, other: Domain, frame: tuple[int, int]) -> None:
        self._scale, self.other = view.depth_scale, other
        self._reprojection = Reprojection(view, view.rgb, other, frame)
        rays = self._reprojection.rays
        u, v, self._inside = into_rgb(rays, view.depth, frame)
        self._u, self._v = (value.astype(np.float32) - np.float32(0.5) for value in (u, v))
        cos, sin = np.cos(view.depth.pitch), np.sin(view.depth.pitch)
        self._axis = np.maximum(cos * rays.forward + sin * rays.up, 1e-6)

    def metres(self, depth: NDArray[Any], valid: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Planar depth of the RGB pixels, (h, w); NaN where unknown."""
        known = np.where(valid, depth * np.float64(self._scale), np.nan).astype(np.float32)
        picked = cv2.remap(known, self._u, self._v, cv2.INTER_NEAREST, borderValue=np.nan)
        return np.where(self._inside, picked / self._axis, np.nan)

    def warp_colours(
        self, sim: ViewImages, real: ViewImages, metres: NDArray[np.float64]
    ) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """RGB (h, w, 3) of the other rig warped into this view at depth `metres`, and its mask."""
        u, v, _, visible = self._reprojection.targets(metres, self.other.rgb)
        warped = _sample_image(real[0], u, v, cv2.INTER_LINEAR).astype(np.float32)
        rgb = sim[0].astype(np.float32)
        return np.where(visible[..., None], _match_colours(warped, rgb, visible), rgb), visible

    def harmonise(self, sim: ViewImages, real: ViewImages) -> HarmonisedPair:
        """Harmonise a pair, with this as the sim view and the other rig as the real one."""
        metres = self.metres(sim[1], sim[2])
        rgb, visible = self.warp_colours(sim, real, metres)
        u, v, expected, inside = self._reprojection.targets(metres, self.other.depth)
        raw = _sample_image(real[1], u, v, cv2.INTER_NEAREST)
        valid = _sample_image(real[2].astype(np.uint8), u, v, cv2.INTER_NEAREST) > 0
        measured = inside & valid
        sim_depth = np.nan_to_num(metres, nan=0.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            warped = raw * self.other.depth_scale * sim_depth / expected
        depth = np.where(measured, warped, sim_depth)
        return HarmonisedPair(
            sim[0].astype(np.float32), rgb,
            sim_depth.astype(np.float32), depth.astype(np.float32), visible, measured,
        )  # fmt: skip

    def warp_from_other(
        self, heat: NDArray[np.float32], depth: NDArray[Any], valid: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Warp heat (fh, fw) of the other rig's image into this view, at the size of its depth.

        NaN where this view's depth is unknown or outside the other rig's view.
        """
        u, v, _, inside = self._reprojection.targets(self.metres(depth, valid), self.other.rgb)
        rows, cols = heat.shape[0] / depth.shape[0], heat.shape[1] / depth.shape[1]
        picked = _sample_image(heat, u * cols, v * rows, cv2.INTER_LINEAR)
        return np.where(inside, picked, np.float32(np.nan)).astype(np.float32)


class ImageAlignment:
    """Both rigs of a run with the calibrated correction, and their views."""

    def __init__(
        self,
        sim: Domain,
        real: Domain,
        frame: tuple[int, int],
        correction: RigOffset,
        tolerance: DepthTolerance | None = None,
    ) -> None:
        self._sim, self._real, self._frame = sim, correction.applied(real), frame
        self._tolerance = tolerance

    @cached_property
    def sim_view(self) -> CameraView:
        return CameraView(self._sim, self._real, self._frame)

    @cached_property
    def real_view(self) -> CameraView:
        return CameraView(self._real, self._sim, self._frame)

    @cached_property
    def counterfactuals(self) -> PairCounterfactuals:
        """Raises RequestError if the noise of the depth sensor was not estimated."""
        if self._tolerance is None:
            raise RequestError("the depth sensor is not calibrated; run `s2r precompute`")
        return PairCounterfactuals(self._sim, self._real, self._frame, self._tolerance)


def _sample_image(
    image: NDArray[Any], u: NDArray[np.float64], v: NDArray[np.float64], method: int
) -> NDArray[Any]:
    """Sample an image at continuous coordinates; pixel i covers [i, i + 1)."""
    x, y = (np.nan_to_num(value - 0.5, nan=-9.0).astype(np.float32) for value in (u, v))
    return np.asarray(cv2.remap(image, x, y, method, borderMode=cv2.BORDER_REPLICATE))


def _match_colours(
    real: NDArray[np.float32], sim: NDArray[np.float32], where: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """R <- (R - mean R) / (std R + c) * (std S + c) + mean S per channel, over `where`."""
    if not where.any():
        return sim
    mask = where.astype(np.uint8)
    (mean, spread), (sim_mean, sim_spread) = (
        (part.ravel().astype(np.float32) for part in cv2.meanStdDev(image, mask=mask))
        for image in (real, sim)
    )
    gain = (sim_spread + COLOUR_FLOOR) / (spread + COLOUR_FLOOR)
    return np.clip((real - mean) * gain + sim_mean, 0, 255)
