"""A real image and its counterfactual as inputs of a network, and mixtures of both."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Side
from s2rtools.counterfactual.factor_composites import mix_sources
from s2rtools.counterfactual.scene_comparison import SceneComparison
from s2rtools.counterfactual.view_synthesis import DepthInRgbView
from s2rtools.models.input_contract import InputContract
from s2rtools.models.preprocessing import preprocess, resize


@dataclass(frozen=True, slots=True, eq=False)
class CounterfactualInputs:
    """Network inputs (C, h, w) of a real image and its counterfactual.

    `segments` (C, h, w) int32 numbers the changed regions in each channel from 1.
    """

    scenes: SceneComparison
    contract: InputContract
    registration: DepthInRgbView
    real: NDArray[np.float32]
    counterfactual: NDArray[np.float32]
    segments: NDArray[np.int32]

    @property
    def count(self) -> int:
        return self.scenes.count

    def in_rgb_pixels(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Sum over the channels of values (n, C, h, w), as (n, h, w) in the pixels of RGB.

        Values of depth are moved to the RGB pixels that show the same direction.
        """
        total: NDArray[np.float32] = values[:, list(self.contract.rows("rgb"))].sum(axis=1)
        for channel in self.contract.rows("depth"):
            total = total + self.registration.moved_to_rgb(values[:, channel])
        return total

    def repaired(self) -> NDArray[np.float32]:
        """The real input, then one per segment with that segment repaired: (n + 1, C, h, w)."""
        inputs = np.repeat(self.real[None], self.count + 1, axis=0)
        for number in range(1, self.count + 1):
            np.copyto(inputs[number], self.counterfactual, where=self.segments == number)
        return inputs


def counterfactual_inputs(
    scenes: SceneComparison,
    real_x: NDArray[np.float32],
    raw_depth: NDArray[Any],
    valid: NDArray[np.bool_],
    registration: DepthInRgbView,
    depth_scale: float,
    contract: InputContract,
) -> CounterfactualInputs:
    """Inputs of a pair that was compared in the real view.

    `real_x` (C, h, w) is the input of the real image; `raw_depth` and `valid` (h, w) are those of
    the real depth camera.
    """
    differs = scenes.depth != scenes.view.real_depth
    changed = registration.to_depth_pixels(differs.astype(np.float32)) > 0
    surface = registration.to_depth_camera(scenes.depth, np.zeros_like(scenes.depth))
    raw = np.where(changed, surface / depth_scale, raw_depth).astype(np.float32)
    has_value = np.where(changed, surface > 0, valid)
    x = preprocess(scenes.rgb[None], raw[None], depth_scale, contract, has_value[None])[0]
    labels = scenes.segments.astype(np.float32)
    planes = np.empty((contract.width, *contract.size), dtype=np.int32)
    planes[list(contract.rows("rgb"))] = _at_size(labels, contract.size)
    of_depth = registration.to_depth_pixels(labels)
    planes[list(contract.rows("depth"))] = _at_size(of_depth, contract.size)
    return CounterfactualInputs(scenes, contract, registration, real_x, x, planes)


@dataclass(frozen=True, slots=True, eq=False)
class OwnView:
    """Both scenes in the view of one side.

    `depth` (h, w) is that of the side's depth camera in metres, 0 where there is no value.
    """

    side: Side
    scenes: SceneComparison
    registration: DepthInRgbView
    depth: NDArray[np.float32]


def composite_inputs(
    sim: OwnView,
    real: OwnView,
    sim_x: NDArray[np.float32],
    real_x: NDArray[np.float32],
    contract: InputContract,
) -> NDArray[np.float32]:
    """Inputs (32, C, h, w) of all combinations of `factor_composites.FACTORS`.

    `sim_x` and `real_x` (C, h, w) are the inputs of the images themselves, which are the first and
    the last composite. What a depth camera sees beyond the RGB view stays that of the view's side.
    """
    inputs = np.empty((2 * 16, *contract.shape), dtype=np.float32)
    for view, out in zip((sim, real), np.split(inputs, 2), strict=True):
        contents = view.scenes.contents(view.side)
        depth = [view.registration.to_depth_camera(d, view.depth) for d in contents.mixed_depths]
        metres = np.stack(depth)
        sources = preprocess(contents.colours, metres, 1.0, contract, metres > 0)
        changed = _at_size(contents.changed.astype(np.float32), contract.size) > 0
        mix_sources(sources, changed, len(contract.rows("rgb")), out)
    inputs[0], inputs[-1] = sim_x, real_x
    return inputs


def _at_size(labels: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    return np.asarray(resize(labels[None], size, "nearest")[0])
