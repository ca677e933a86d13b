"""Compare what a camera sees in simulation and in reality: light, depth and changed content."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Domain, Side
from s2rtools.counterfactual.depth_tolerance import DepthTolerance
from s2rtools.counterfactual.factor_composites import ViewContents
from s2rtools.counterfactual.relighting import Relighting, relight
from s2rtools.counterfactual.view_synthesis import DepthInRgbView, Frame, ViewSynthesis

MAX_SEGMENTS = 14
LEAST_AREA = 14 / 128**2
"""Share of the image from which a changed region counts as a segment."""
LEAST_RESIDUAL = 10.0
"""Grey levels of residual from which a pixel may count as changed."""
RESIDUAL_FACTOR = 3.5
"""Multiple of the median residual from which a pixel counts as changed."""
DOUBTFUL_WEIGHT = 0.05
"""Weight of pixels whose depths disagree when the light is fitted."""

ImageArrays = tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_]]
"""RGB (h, w, 3), raw depth (h, w) and its validity (h, w)."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewPair:
    """Colours and depth of both scenes in the pixels of one RGB camera.

    RGB (h, w, 3) float32 levels 0 .. 255; planar depth (h, w) in metres, 0 where there is none.
    `seen` (h, w) marks the pixels that both cameras show.
    """

    sim: NDArray[np.float32]
    real: NDArray[np.float32]
    sim_depth: NDArray[np.float32]
    real_depth: NDArray[np.float32]
    seen: NDArray[np.bool_]


class SceneComparison:
    """The light and the changed content between both scenes of a view.

    `change` (h, w) float32 is the difference in multiples of what noise explains; `segments` (h, w)
    int32 numbers the changed regions from 1.
    """

    def __init__(self, view: ViewPair, tolerance: DepthTolerance) -> None:
        self.view, self._tolerance = view, tolerance
        measured = (view.real_depth > 0) & (view.sim_depth > 0) & view.seen
        expected = tolerance.expected(view.sim_depth)
        difference = np.where(measured, np.abs(view.real_depth - expected), np.float32(0))
        limit = tolerance.changed(view.sim_depth)
        weight = view.seen.astype(np.float32)
        weight[difference > limit] = DOUBTFUL_WEIGHT
        self.light: Relighting = relight(view.sim, view.real, view.sim_depth, weight)
        colour = self.light.residual / max(LEAST_RESIDUAL, RESIDUAL_FACTOR * self.light.spread)
        self.change = np.maximum(np.where(view.seen, colour, np.float32(0)), difference / limit)
        self.segments = cut_segments(self.change)
        self._differs = difference > tolerance.agreeing(view.sim_depth)

    @property
    def count(self) -> int:
        """Number of segments."""
        return int(self.segments.max(initial=0))

    @cached_property
    def rgb(self) -> NDArray[np.float32]:
        """Colours (h, w, 3) of the counterfactual: sim content under the real light."""
        return _shown(self.view.seen, self.light.image, self.view.real)

    @cached_property
    def depth(self) -> NDArray[np.float32]:
        """Depth (h, w) of the counterfactual in metres, 0 where there is no value.

        Real depth where it agrees with the sim surface or is missing, else that surface as the real
        sensor would return it.
        """
        return np.where(self._differs, self._sensed_depth, self.view.real_depth)

    def contents(self, own: Side) -> ViewContents:
        """The contents of the view of side `own` for composites of factors.

        Both scenes show what the own side shows where the other camera does not see.
        """
        view, light, seen = self.view, self.light, self.view.seen
        unlit_real = light.removed(view.real)
        clean = self._tolerance.surface(view.real_depth)
        depths = (view.sim_depth, self._sensed_depth,
                  np.where(clean > 0, clean, view.sim_depth), view.real_depth)  # fmt: skip
        if own == "sim":
            colours = (view.sim, light.image, _shown(seen, unlit_real, view.sim),
                       _shown(seen, view.real, light.image))  # fmt: skip
            beyond = view.sim_depth
        else:
            colours = (_shown(seen, view.sim, unlit_real), _shown(seen, light.image, view.real),
                       unlit_real, view.real)  # fmt: skip
            beyond = view.real_depth
        shown = np.stack([np.where(view.seen, depth, beyond) for depth in depths])
        return ViewContents(np.stack(colours), shown, self.segments > 0)

    @property
    def _sensed_depth(self) -> NDArray[np.float32]:
        """The sim surface as the real sensor returns it, without noise."""
        depth = self.view.sim_depth
        is_returned = self._tolerance.in_range(depth)
        return np.where(is_returned, self._tolerance.expected(depth), np.float32(0))


class RigPair:
    """The calibrated rigs of a run, for images of one size; compares both scenes in either view."""

    def __init__(self, sim: Domain, real: Domain, frame: Frame, tolerance: DepthTolerance) -> None:
        self._to_real, self._to_sim = (
            ViewSynthesis(sim, real, frame),
            ViewSynthesis(real, sim, frame),
        )
        self.sim, self.real = DepthInRgbView(sim, frame), DepthInRgbView(real, frame)
        self._tolerance = tolerance

    def in_real_view(self, sim: ImageArrays, real: ImageArrays) -> SceneComparison:
        """Compare a pair of images at one pose in the view of the real RGB camera."""
        made = self._to_real(sim[0], self.sim.metres(*sim[1:]))
        metres = self.real.metres(*real[1:])
        view = ViewPair(made.rgb, real[0].astype(np.float32), made.depth, metres, made.seen)
        return SceneComparison(view, self._tolerance)

    def in_sim_view(self, sim: ImageArrays, real: ImageArrays) -> SceneComparison:
        """Compare a pair of images in the view of the sim RGB camera, located by its depth."""
        metres = self.sim.metres(*sim[1:])
        made = self._to_sim.sampled(real[0], self.real.metres(*real[1:]), metres)
        view = ViewPair(sim[0].astype(np.float32), made.rgb, metres, made.depth, made.seen)
        return SceneComparison(view, self._tolerance)

    def labels_in_real_view(self, labels: NDArray[Any], sim: ImageArrays) -> NDArray[Any]:
        """Labels (h, w) of the sim RGB image in the real view, 0 where that is not seen."""
        return self._to_real.nearest(labels, self.sim.metres(*sim[1:]))

    def to_sim_view(self, values: NDArray[np.float32], sim: ImageArrays) -> NDArray[np.float32]:
        """Values (n, h, w) over the real RGB image in the sim view, 0 where that is not seen."""
        return self._to_sim.warped(values, self.sim.metres(*sim[1:]))


def _shown(
    seen: NDArray[np.bool_], image: NDArray[np.float32], elsewhere: NDArray[np.float32]
) -> NDArray[np.float32]:
    """An image (h, w, 3) where it is seen (h, w), another one elsewhere."""
    return np.asarray(cv2.copyTo(image, seen.view(np.uint8), elsewhere.copy()))


def cut_segments(change: NDArray[np.float32]) -> NDArray[np.int32]:
    """Number the regions (h, w) where `change` exceeds 1, the largest first; 0 elsewhere.

    Small regions are left out, near ones are joined, and each grows by a pixel.
    """
    changed = (change > 1).astype(np.uint8)
    changed = cv2.morphologyEx(changed, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    changed = cv2.morphologyEx(changed, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(changed, connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    kept = [label for label in np.argsort(-areas, kind="stable")[:MAX_SEGMENTS]
            if areas[label] >= max(2.0, LEAST_AREA * change.size)]  # fmt: skip
    number = np.zeros(count, dtype=np.float32)
    number[kept] = np.arange(1, len(kept) + 1)
    # Of two segments that meet, the smaller one keeps the pixel.
    return np.asarray(cv2.dilate(number[labels], np.ones((3, 3), np.uint8)).astype(np.int32))
