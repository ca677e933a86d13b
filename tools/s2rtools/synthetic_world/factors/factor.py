"""What a factor may change on the way from a world to a real image."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rtools.synthetic_world.renderer import Camera
from s2rtools.synthetic_world.scene import WorldScene

Generator = np.random.Generator


class Factor:
    """One named reason why reality looks different; severity 0 changes nothing, 1 is the default.

    A factor overrides the steps that it has a part in. Images are seeded per instance, so that a
    view is the same whatever else is rendered.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    shapes_scene: ClassVar[bool] = False
    """Whether another severity is another scene, beyond the camera and its sensors."""
    moves_robot: ClassVar[bool] = False
    """Whether it is seen in drives alone, and in no image."""

    def scene(self, scene: WorldScene, severity: float) -> WorldScene:
        """Other lights."""
        return scene

    def camera(self, camera: Camera, severity: float) -> Camera:
        """Another mount or lens."""
        return camera

    def rgb(
        self, rgb: NDArray[np.float32], depth: NDArray[Any], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        """One image (h, w, 3) in 0 .. 255, with its true depth (h, w) in metres."""
        return rgb

    def depth(
        self, depth: NDArray[np.float32], rng: Generator, severity: float
    ) -> NDArray[np.float32]:
        """One depth image (h, w) in metres, 0 where there is no return."""
        return depth
