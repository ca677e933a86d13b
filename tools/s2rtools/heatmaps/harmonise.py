"""The real image as the simulator's camera would have taken it, from where the sim depth says.

Source of the idea: image-based rendering by depth, and the colour transfer of Reinhard et al.
(2001), here per channel of the image itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.geometry.camera import into_rgb, rays
from s2rstore.records import Domain, Intrinsics

COLOUR_FLOOR = 5.0
"""Added to both deviations, in grey levels, so that flat images are not blown up."""


@dataclass(frozen=True, slots=True)
class Correction:
    """What the declared real camera is off by: metres of height, a factor of the focal length."""

    height: float = 0.0
    zoom: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class Harmonised:
    """One real view in the sim camera's frame.

    rgb (h, w, 3) float32 0 .. 255, colours matched; depth (h, w) float32 metres; `seen` where the
    real camera looked; `measured` where its depth is valid too. The rest repeats the sim view.
    """

    rgb: NDArray[np.float32]
    depth: NDArray[np.float32]
    seen: NDArray[np.bool_]
    measured: NDArray[np.bool_]


class Warp:
    """Brings real images into the view of a sim camera; made once for a pair of domains."""

    def __init__(
        self, sim: Domain, real: Domain, frame: tuple[int, int], correction: Correction
    ) -> None:
        self._frame = frame
        self._real_rgb, self._real_depth = (
            _zoomed(lens, correction.zoom) for lens in (real.rgb, real.depth)
        )
        self._rise = sim.camera_height - real.camera_height - correction.height
        self._ahead = sim.forward_offset - real.forward_offset
        self._sim_scale, self._real_scale = sim.depth_scale, real.depth_scale
        rows, cols = (np.arange(extent, dtype=np.float64) + 0.5 for extent in frame)
        self._rays = rays(sim.rgb, rows, cols)
        u, v, self._inside = into_rgb(self._rays, sim.depth, frame)
        self._u, self._v = (value.astype(np.float32) - np.float32(0.5) for value in (u, v))
        cos, sin = np.cos(sim.depth.pitch), np.sin(sim.depth.pitch)
        self._axis = cos * self._rays.forward + sin * self._rays.up

    def sim_metres(self, depth: NDArray[Any], valid: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Distance along the rays of the sim RGB pixels, (h, w); NaN where depth is invalid."""
        metres = np.where(valid, depth * np.float64(self._sim_scale), np.nan).astype(np.float32)
        picked = cv2.remap(metres, self._u, self._v, cv2.INTER_NEAREST, borderValue=np.nan)
        return np.where(self._inside, picked / np.maximum(self._axis, 1e-6), np.nan)

    def targets(
        self, metres: NDArray[np.float64], lens: Intrinsics
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
        """Column, row and planar depth in a real camera of what sim pixels see, and validity."""
        with np.errstate(invalid="ignore", divide="ignore"):
            right = metres * self._rays.right
            up = metres * self._rays.up + self._rise
            ahead = metres * self._rays.forward + self._ahead
            cos, sin = np.cos(lens.pitch), np.sin(lens.pitch)
            depth = cos * ahead + sin * up
            u = lens.cx + lens.fx * right / depth
            v = lens.cy - lens.fy * (cos * up - sin * ahead) / depth
            ok = (depth > 0.05) & (u >= 0) & (u < self._frame[1]) & (v >= 0) & (v < self._frame[0])
        return u, v, depth, ok

    def __call__(
        self,
        sim_rgb: NDArray[np.uint8],
        sim_depth: NDArray[Any],
        sim_valid: NDArray[np.bool_],
        real_rgb: NDArray[np.uint8],
        real_depth: NDArray[Any],
        real_valid: NDArray[np.bool_],
    ) -> Harmonised:
        """Warp one pair: RGB (H, W, 3), raw depth and validity (H, W) of both sides."""
        metres = self.sim_metres(sim_depth, sim_valid)
        u, v, _, seen = self.targets(metres, self._real_rgb)
        warped = _sampled(real_rgb, u, v, cv2.INTER_LINEAR).astype(np.float32)
        u, v, expected, inside = self.targets(metres, self._real_depth)
        raw = _sampled(real_depth, u, v, cv2.INTER_NEAREST)
        measured = inside & (_sampled(real_valid.astype(np.uint8), u, v, cv2.INTER_NEAREST) > 0)
        along = np.where(np.isnan(metres), 0.0, metres)
        with np.errstate(invalid="ignore", divide="ignore"):
            depth = np.where(measured, raw * self._real_scale * along / expected, along)
        own = sim_rgb.astype(np.float32)
        rgb = _colours_matched(warped, own, seen)
        return Harmonised(
            np.where(seen[..., None], rgb, own), depth.astype(np.float32), seen, measured
        )


def _sampled(
    image: NDArray[Any], u: NDArray[np.float64], v: NDArray[np.float64], method: int
) -> NDArray[Any]:
    """The image at continuous coordinates whose pixel i covers [i, i + 1)."""
    x, y = (np.nan_to_num(value - 0.5, nan=-9.0).astype(np.float32) for value in (u, v))
    return np.asarray(cv2.remap(image, x, y, method, borderMode=cv2.BORDER_REPLICATE))


def _zoomed(lens: Intrinsics, zoom: float) -> Intrinsics:
    return replace(lens, fx=lens.fx * zoom, fy=lens.fy * zoom)


def _colours_matched(
    real: NDArray[np.float32], sim: NDArray[np.float32], where: NDArray[np.bool_]
) -> NDArray[np.float32]:
    """R <- (R - mean R) / (std R + c) * (std S + c) + mean S per channel, over `where`."""
    if not where.any():
        return sim
    ours, theirs = real[where], sim[where]
    gain = (theirs.std(axis=0) + COLOUR_FLOOR) / (ours.std(axis=0) + COLOUR_FLOOR)
    return np.clip((real - ours.mean(axis=0)) * gain + theirs.mean(axis=0), 0, 255)


GRID_HEIGHT = np.round(np.arange(-0.16, 0.161, 0.02), 3)
GRID_ZOOM = np.round(np.arange(0.88, 1.141, 0.02), 3)
MAX_FRAMES = 40


def calibrate(
    sim: Domain, real: Domain, frame: tuple[int, int], pairs: list[tuple[NDArray[Any], ...]]
) -> Correction:
    """The height and field of view of the real camera under which image gradients agree best.

    `pairs` are at most a few dozen (sim rgb, depth, valid, real rgb, depth, valid). The score is
    the mean correlation of gradient magnitudes between the sim and the warped real image; the
    answer is the best of a grid of 2 cm by 2 %, and no correction where that is not better.
    """
    best, chosen = -np.inf, Correction()
    for correction in _candidates(sim, real, frame, pairs):
        score = _agreement(Warp(sim, real, frame, correction), pairs)
        if score > best + 1e-9:
            best, chosen = score, correction
    return chosen


def _candidates(
    sim: Domain, real: Domain, frame: tuple[int, int], pairs: list[tuple[NDArray[Any], ...]]
) -> list[Correction]:
    """No correction first; then zooms at their best height, and heights at the best zoom."""
    found = [Correction()]
    coarse = [Correction(float(h), float(z)) for h in GRID_HEIGHT[::2] for z in GRID_ZOOM[::2]]
    few = pairs[:: max(1, len(pairs) // 10)]
    scores = [_agreement(Warp(sim, real, frame, c), few) for c in coarse]
    around = coarse[int(np.argmax(scores))]
    found += [
        Correction(float(h), float(z))
        for h in GRID_HEIGHT if abs(h - around.height) < 0.03
        for z in GRID_ZOOM if abs(z - around.zoom) < 0.03
    ]  # fmt: skip
    return found


def _agreement(warp: Warp, pairs: list[tuple[NDArray[Any], ...]]) -> float:
    scores = []
    for pair in pairs:
        made = warp(*pair)
        if made.seen.mean() < 0.2:
            continue
        a, b = _gradient(pair[0]), _gradient(made.rgb)
        inner = cv2.erode(made.seen.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
        if inner.sum() < 100:
            continue
        with np.errstate(invalid="ignore"):
            found = np.corrcoef(a[inner], b[inner])[0, 1]
        if np.isfinite(found):
            scores.append(float(found))
    return float(np.mean(scores)) if scores else -np.inf


def _gradient(image: NDArray[Any]) -> NDArray[np.float32]:
    grey = cv2.cvtColor(image.astype(np.float32), cv2.COLOR_RGB2GRAY)
    grey = cv2.GaussianBlur(grey, (0, 0), 1.0)
    return np.asarray(
        np.hypot(cv2.Sobel(grey, cv2.CV_32F, 1, 0), cv2.Sobel(grey, cv2.CV_32F, 0, 1))
    )
