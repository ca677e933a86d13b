"""The synthetic world as a renderer program: `python -m s2rtools.renderer.world --seed 1`.

Its frames are those that `s2r ingest world` writes on the sim side.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from s2rstore.records import Intrinsics
from s2rtools.renderer import CameraPose, Hello, Parameter, serve
from s2rtools.renderer.serving import Render
from s2rtools.synthetic_world.renderer import Camera
from s2rtools.synthetic_world.world import DEPTH_SCALE, to_raw_depth, world_of

VERSION = "1"
"""Changes whenever the frames do."""
PARAMETERS = (
    Parameter("lamp_power", 1.0, 0.0, 4.0),
    Parameter("window_power", 1.0, 0.0, 4.0),
    Parameter("camera_height", 0.0, -0.5, 1.5, "m"),
    Parameter("camera_pitch", 0.0, -30.0, 30.0, "deg"),
    Parameter("zoom", 1.0, 0.5, 2.0),
)
"""Factors of the light and of the focal length; metres and degrees up that the camera moves."""
_PITCH_DIGITS = 12


def camera_of(pose: CameraPose, camera: Hello) -> Camera:
    """The camera of the ray caster that stands level or is pitched at a pose."""
    pitch = round(math.asin(np.clip(pose.rotation[2, 2], -1, 1)), _PITCH_DIGITS)
    lens = Intrinsics(camera.fx, camera.fy, camera.cx, camera.cy, pitch)
    ahead = pose.position[0] - pose.x, (-1 if camera.y_down else 1) * pose.position[1] - pose.y
    offset = ahead[0] * math.cos(pose.heading) + ahead[1] * math.sin(pose.heading)
    return Camera(
        (camera.height, camera.width), lens, pose.position[2], round(offset, _PITCH_DIGITS)
    )


def world_renderer(seed: int) -> Render:
    """The function that renders the sim side of a world for `serve`."""
    world = world_of(seed)

    def render(
        pose: CameraPose, camera: Hello, values: dict[str, float]
    ) -> tuple[NDArray[np.uint8], NDArray[Any]]:
        moved = camera_of(pose, camera).moved(
            values["camera_height"], math.radians(values["camera_pitch"]), values["zoom"]
        )
        renderer = world.lit_renderer({}, values["lamp_power"], values["window_power"])
        views = renderer.render(np.array([[pose.x, pose.y, pose.heading]]), moved)
        return views.rgb[0], to_raw_depth(views.depth)[0] * np.float32(DEPTH_SCALE)

    return render


def main() -> None:
    parser = argparse.ArgumentParser(description="Render the synthetic world for s2r render.")
    parser.add_argument("--seed", type=int, default=1, help="random seed of the building")
    seed = parser.parse_args().seed
    serve(world_renderer(seed), f"synthetic world {seed}", VERSION, PARAMETERS)


if __name__ == "__main__":
    main()
