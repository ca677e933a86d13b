"""Factors of the scene: `lights` (lighting, white balance), `objects` (changes since the scan)."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rtools.synthetic_world.factors.factor import Factor, Generator
from s2rtools.synthetic_world.materials import hashed
from s2rtools.synthetic_world.scene_geometry import WorldScene


class Lights(Factor):
    """One lamp in seven is off, the others are warmer, windows shine in by a quarter more, and the
    white balance leaves 6 % more red and 10 % less blue.
    """

    name = "lights"
    group = "lighting"
    description = "lamps off, warmer light, brighter windows, white balance"
    shapes_scene = True

    def scene(self, scene: WorldScene, severity: float) -> WorldScene:
        lamps = []
        for number, lamp in enumerate(scene.lamps):
            red, green, blue = lamp.power
            if lamp.window:
                power = tuple(value * (1 + 0.25 * severity) for value in lamp.power)
            elif hashed(number, 17, 5) < 0.14 * severity:
                power = (0.02, 0.02, 0.02)
            else:
                power = (red * (1 + 0.03 * severity), green, blue * (1 - 0.06 * severity))
            lamps.append(replace(lamp, power=(power[0], power[1], power[2])))
        dimmed = tuple(value * (1 - 0.08 * severity) for value in scene.ambient)
        return replace(scene, lamps=tuple(lamps), ambient=(dimmed[0], dimmed[1], dimmed[2]))

    def rgb(
        self, rgb: NDArray[np.float32], depth: NDArray[Any], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        gains = np.array([1 + 0.03 * severity, 1.0, 1 - 0.04 * severity])
        return rgb * gains.astype(np.float32)


class Objects(Factor):
    """The first share of the world's changes, all of them from severity 1 on. `World` applies it,
    because only it knows both positions of an object.
    """

    name = "objects"
    group = "objects"
    description = "objects removed, added, moved, doors closed"
    shapes_scene = True
