"""Composites of a sim and a real image in which each factor of the gap is that of either side.

The factors are lighting (colours of the same surface), depth (noise, holes and range of the depth
sensor), objects (changed content), sensor (noise and blur of colours) and camera (mount and lens).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import GAP_FACTORS
from s2rtools.counterfactual.relighting import Relighting

FACTORS = GAP_FACTORS
VIEW_FACTORS = FACTORS[:-1]
"""The factors that differ within the view of one camera."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewContents:
    """What one camera's view shows in simulation and in reality.

    `sim` and `real` (h, w, 3) float32 levels 0 .. 255, `light` takes `sim` to the real light;
    `changed` (h, w) marks changed content. `sim_depth` and `real_depth` (h, w) in metres, 0 where
    there is no value; `sensed_depth` is the sim surface as the real sensor would return it.
    """

    sim: NDArray[np.float32]
    real: NDArray[np.float32]
    light: Relighting
    changed: NDArray[np.bool_]
    sim_depth: NDArray[np.float32]
    sensed_depth: NDArray[np.float32]
    real_depth: NDArray[np.float32]

    def composites(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """RGB (16, h, w, 3) and depth (16, h, w) of all combinations of `VIEW_FACTORS`.

        The index of a composite has the bit 1 << i set where factor i is that of reality. Composite
        0 is the sim image, the last one the real image.
        """
        lit = self.light.image
        unlit_real = self.light.removed(self.real)
        rgb, depth = [], []
        changed = self.changed[..., None]
        for sensor, objects, noisy_depth, lighting in product((False, True), repeat=4):
            content = self.real if lighting else unlit_real
            clean = lit if lighting else self.sim
            kept = content if sensor else clean
            rgb.append(np.where(changed, content if objects else clean, kept))
            depth.append(self._depth(objects, noisy_depth))
        return np.stack(rgb), np.stack(depth)

    def _depth(self, objects: bool, sensed: bool) -> NDArray[np.float32]:
        if sensed:
            inside = self.real_depth if objects else self.sensed_depth
            return np.where(self.changed, inside, self.real_depth)
        clean = np.where(self.real_depth > 0, self.real_depth, self.sim_depth)
        return np.where(self.changed, clean, self.sim_depth) if objects else self.sim_depth
