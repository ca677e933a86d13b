"""Renderer `floor:GREY`: an empty floor of one grey value, `--renderer floor:90`."""

from __future__ import annotations

import sys
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from s2rtools.renderer import CameraPose, Hello, Parameter, serve
from s2rtools.simulated_frames.pose_renderer import NamedRenderer

RENDERER = NamedRenderer("s2r_example_plugins.renderer")


def render(
    pose: CameraPose, camera: Hello, parameters: Mapping[str, float]
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    row, column = np.mgrid[: camera.height, : camera.width] + 0.5
    x, y = (column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy
    slope = np.stack([x, y, np.ones_like(x)], axis=-1) @ pose.rotation[2]
    depth = np.where(slope < 0, pose.position[2] / np.maximum(-slope, 1e-9), 0)
    grey = np.where(depth > 0, float(sys.argv[1]) * parameters["light"], 200).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2), depth


if __name__ == "__main__":
    serve(render, "grey floor", "1", [Parameter("light", 1.0, 0.0, 2.0)])
