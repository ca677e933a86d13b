"""Composites of a sim and a real image in which each factor of the gap is that of either side.

The factors are lighting (colours of the same surface), depth (noise, holes and range of the depth
sensor), objects (changed content), sensor (noise and blur of colours) and camera (mount and lens).
"""

from __future__ import annotations

from dataclasses import dataclass

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

    def sources(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """RGB (4, h, w, 3) and depth (4, h, w) that all composites are made of.

        Colours: content of sim or real (bit 1) in the light of sim or real (bit 0). Depth: content
        of sim or real (bit 1), as the sensor of sim or real (bit 0) returns it.
        """
        rgb = np.stack([self.sim, self.light.image, self.light.removed(self.real), self.real])
        clean = np.where(self.real_depth > 0, self.real_depth, self.sim_depth)
        depth = [
            self.sim_depth,
            np.where(self.changed, self.sensed_depth, self.real_depth),
            np.where(self.changed, clean, self.sim_depth),
            self.real_depth,
        ]
        return rgb, np.stack(depth)


def mix_sources(
    sources: NDArray[np.float32], changed: NDArray[np.bool_], colours: int
) -> NDArray[np.float32]:
    """Composites (16, C, h, w) of all combinations of `VIEW_FACTORS`.

    `sources` (4, C, h, w) are those of `ViewContents.sources`, of which the first `colours`
    channels are colours; `changed` (h, w) marks changed content in them. The index of a composite
    has the bit 1 << i set where factor i is that of reality: composite 0 is the sim image, the last
    one the real image.
    """
    mixed = np.empty((16, *sources.shape[1:]), dtype=np.float32)
    for index in range(len(mixed)):
        lighting, depth, objects, sensor = (index >> bit & 1 for bit in range(4))
        inside, outside = (sources[2 * content + lighting] for content in (objects, sensor))
        np.copyto(mixed[index, :colours], outside[:colours])
        np.copyto(mixed[index, :colours], inside[:colours], where=changed)
        mixed[index, colours:] = sources[2 * objects + depth, colours:]
    return mixed
