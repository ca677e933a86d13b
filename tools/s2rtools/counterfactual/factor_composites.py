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

FACTORS = GAP_FACTORS
VIEW_FACTORS = FACTORS[:-1]
"""The factors that differ within the view of one camera."""


@dataclass(frozen=True, slots=True, eq=False)
class ViewContents:
    """What one camera's view shows in simulation and in reality.

    `colours` (4, h, w, 3) float32 levels 0 .. 255: content of sim or real (bit 1) in the light of
    sim or real (bit 0). `depths` (4, h, w) in metres, 0 where there is no value: content of sim or
    real (bit 1), as the sensor of sim or real (bit 0) returns it. `changed` (h, w) marks changed
    content.
    """

    colours: NDArray[np.float32]
    depths: NDArray[np.float32]
    changed: NDArray[np.bool_]

    @property
    def mixed_depths(self) -> NDArray[np.float32]:
        """Depth (4, h, w) with exchanged objects (bit 1) or sensors (bit 0) of the whole view."""
        sim, sensed, clean, real = self.depths
        noisy, restored = np.where(self.changed, sensed, real), np.where(self.changed, clean, sim)
        return np.stack([sim, noisy, restored, real])


def mix_sources(
    sources: NDArray[np.float32],
    changed: NDArray[np.bool_],
    colours: int,
    out: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Composites (16, C, h, w) of all combinations of `VIEW_FACTORS`, in `out` where it is given.

    `sources` (4, C, h, w) are inputs made of `ViewContents.colours` and `mixed_depths`; the first
    `colours` channels are colours. `changed` (h, w) marks changed content in them. The index of a
    composite has the bit 1 << i set where factor i is that of reality: composite 0 is the sim
    image, the last one the real image.
    """
    mixed = np.empty((16, *sources.shape[1:]), dtype=np.float32) if out is None else out
    by_factor = mixed.reshape(2, 2, 2, 2, *sources.shape[1:])
    for sensor, objects, lighting in product((0, 1), repeat=3):
        inside, outside = (sources[2 * each + lighting, :colours] for each in (objects, sensor))
        shown = outside if objects == sensor else np.where(changed, inside, outside)
        by_factor[sensor, objects, :, lighting, :colours] = shown
    for objects, depth in product((0, 1), repeat=2):
        by_factor[:, objects, depth, :, colours:] = sources[2 * objects + depth, colours:]
    return mixed
