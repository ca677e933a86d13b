"""Factor `camera`: the rig is mounted differently from its declaration."""

from __future__ import annotations

from s2rtools.synthetic_world.factors.factor import Factor
from s2rtools.synthetic_world.renderer import Camera


class CameraMount(Factor):
    """The camera sits 9 cm lower and has a 6 % longer focal length than declared."""

    name = "camera"
    description = "camera height and field of view"

    def camera(self, camera: Camera, severity: float) -> Camera:
        return camera.moved(height=-0.09 * severity, zoom=1 + 0.06 * severity)
