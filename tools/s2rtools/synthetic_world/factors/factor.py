"""Base class of factors: the steps from a world to a real image that a factor may change."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from s2rtools.synthetic_world.renderer import Camera
from s2rtools.synthetic_world.scene_geometry import WorldScene

Generator = np.random.Generator


class Factor:
    """A named cause of the gap; severity 0 changes nothing, 1 is the default.

    A subclass overrides the steps that it changes. Its dataclass fields are constants that a
    recipe may set, such as `exposure.vignette`. Noise is seeded per instance, so that a view
    does not depend on what else is rendered.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    shapes_scene: ClassVar[bool] = False
    """Whether the severity changes the scene itself, not only the camera and its sensors."""
    moves_robot: ClassVar[bool] = False
    """Whether it changes drives only, and no image."""
    group: ClassVar[str | None] = None
    """Group of which the factor's share of the gap is a part; None for factors of the robot."""

    def scene(self, scene: WorldScene, severity: float) -> WorldScene:
        """The scene with other lights."""
        return scene

    def camera(self, camera: Camera, severity: float) -> Camera:
        """The camera with another mount or lens."""
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
