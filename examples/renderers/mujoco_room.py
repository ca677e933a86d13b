"""A room in MuJoCo as a renderer of `s2r render`, without a screen.

    s2r render S.s2r --renderer 'python examples/renderers/mujoco_room.py' --random 100 --out DIR

The room is 6 m x 5 m from the origin of the map, 2.6 m high. Lights, textures and camera are
parameters. Needs `pip install 's2rtui[tools,mujoco]'` and EGL; with `MUJOCO_GL=osmesa` OSMesa.
"""

from __future__ import annotations

import math
import os
from importlib import import_module
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from s2rtools.renderer import CameraPose, Hello, Parameter, serve

VERSION = "1"
PARAMETERS = (
    Parameter("lamp_power", 1.0, 0.2, 2.0),
    Parameter("window_power", 1.0, 0.0, 2.0),
    Parameter("texture_contrast", 1.0, 0.2, 2.0),
    Parameter("zoom", 1.0, 0.7, 1.4),
    Parameter("camera_height", 0.0, -0.3, 0.6, "m"),
    Parameter("camera_pitch", 0.0, -20.0, 20.0, "deg"),
    Parameter("distortion", 0.0, -0.3, 0.3),
)
"""Factors of lights, textures and focal length; metres and degrees up that the camera moves.

`distortion` is the first radial coefficient of OpenCV's camera model.
"""
WIDTH, LENGTH, HEIGHT = 6.0, 5.0, 2.6
_MODEL = f"""
<mujoco>
  <visual>
    <quality shadowsize="1024" offsamples="0"/>
    <headlight ambient=".25 .25 .25" diffuse="0 0 0" specular="0 0 0"/>
    <global offwidth="2048" offheight="2048"/>
    <map znear=".002" zfar="3"/>
  </visual>
  <statistic center="3 2.5 1.3" extent="8"/>
  <asset>
    <texture name="floor" type="2d" builtin="checker" width="128" height="128"
      rgb1=".62 .45 .30" rgb2=".45 .31 .20"/>
    <texture name="wall" type="2d" builtin="checker" width="128" height="128"
      rgb1=".80 .78 .70" rgb2=".70 .72 .74"/>
    <texture name="rug" type="2d" builtin="checker" width="128" height="128"
      rgb1=".60 .15 .18" rgb2=".20 .22 .45"/>
    <material name="floor" texture="floor" texrepeat="8 8" specular="0"/>
    <material name="wall" texture="wall" texrepeat="6 3" specular="0"/>
    <material name="rug" texture="rug" texrepeat="3 3" specular="0"/>
  </asset>
  <worldbody>
    <light name="lamp" pos="2.4 2.5 2.4" dir="0 0 -1" cutoff="180" diffuse=".7 .68 .6"
      attenuation="1 .05 .02" castshadow="true"/>
    <light name="window" pos="5.8 2.5 1.6" dir="-1 0 -.2" cutoff="90" diffuse=".25 .3 .4"
      castshadow="false"/>
    <geom type="box" pos="3 2.5 -.05" size="3.2 2.7 .05" material="floor"/>
    <geom type="box" pos="3 2.5 {HEIGHT + 0.05}" size="3.2 2.7 .05" rgba=".85 .85 .82 1"/>
    <geom type="box" pos="-.05 2.5 1.3" size=".05 2.6 1.3" material="wall"/>
    <geom type="box" pos="{WIDTH + 0.05} 2.5 1.3" size=".05 2.6 1.3" material="wall"/>
    <geom type="box" pos="3 -.05 1.3" size="3.1 .05 1.3" material="wall"/>
    <geom type="box" pos="3 {LENGTH + 0.05} 1.3" size="3.1 .05 1.3" material="wall"/>
    <geom type="box" pos="3 2.5 .005" size="1 .8 .005" material="rug"/>
    <geom type="box" pos="1 4.6 .9" size=".6 .35 .9" rgba=".35 .22 .14 1"/>
    <geom type="box" pos="4.9 .7 .37" size=".7 .45 .37" rgba=".2 .35 .3 1"/>
    <geom type="cylinder" pos=".7 .7 .45" size=".3 .45" rgba=".7 .5 .1 1"/>
    <geom type="sphere" pos="5.3 4.3 .4" size=".4" rgba=".25 .3 .6 1"/>
    <geom type="box" pos="3 4.99 1.5" size=".8 .01 .5" rgba=".5 .65 .8 1"/>
    <body name="rig" mocap="true"><camera name="rig"/></body>
  </worldbody>
</mujoco>
"""
_TO_OPENGL = np.diag([1.0, -1.0, -1.0])
"""Turns the axes of OpenGL's camera (x right, y up, z back) into the optical axes."""


class Room:
    """The room with an off-screen context of the size of the camera's frames."""

    def __init__(self, width: int, height: int) -> None:
        self._model = mujoco.MjModel.from_xml_string(_MODEL)
        self._data = mujoco.MjData(self._model)
        backend = os.environ.get("MUJOCO_GL", "egl")
        self._gl = import_module(f"mujoco.{backend}").GLContext(width, height)
        self._gl.make_current()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._context.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        self._scene = mujoco.MjvScene(self._model, maxgeom=100)
        self._view = mujoco.MjvCamera()
        self._view.type, self._view.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
        self._lights = self._model.light_diffuse.copy()
        self._textures = self._model.tex_data.copy()
        self._contrast = 1.0
        self._model.cam_resolution[0] = width, height
        self._model.cam_sensorsize[0] = width, height

    def render(
        self, pose: CameraPose, camera: Hello, values: dict[str, float]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        """RGB (h, w, 3) and depth (h, w) in metres along the optical axis."""
        self._set_lights_and_textures(values)
        self._set_camera(pose, camera, values)
        mujoco.mj_forward(self._model, self._data)
        mujoco.mjv_updateScene(
            self._model, self._data, mujoco.MjvOption(), None, self._view,
            mujoco.mjtCatBit.mjCAT_ALL, self._scene,
        )  # fmt: skip
        area = mujoco.MjrRect(0, 0, camera.width, camera.height)
        mujoco.mjr_render(area, self._scene, self._context)
        rgb = np.empty((camera.height, camera.width, 3), np.uint8)
        z = np.empty((camera.height, camera.width), np.float32)
        mujoco.mjr_readPixels(rgb, z, area, self._context)
        extent, planes = self._model.stat.extent, self._model.vis.map
        near, far = planes.znear * extent, planes.zfar * extent
        with np.errstate(divide="ignore"):
            metres = near * far / (near + z.astype(np.float64) * (far - near))
        metres[z <= 0] = 0
        return _distorted(rgb[::-1], metres[::-1].astype(np.float32), camera, values)

    def _set_lights_and_textures(self, values: dict[str, float]) -> None:
        powers = np.array([values["lamp_power"], values["window_power"]])
        self._model.light_diffuse[:] = self._lights * powers[:, None]
        contrast = values["texture_contrast"]
        if contrast != self._contrast:
            self._contrast = contrast
            for texture in range(self._model.ntex):
                start = self._model.tex_adr[texture]
                size = (
                    self._model.tex_height[texture] * self._model.tex_width[texture]
                    * self._model.tex_nchannel[texture]
                )  # fmt: skip
                texels = self._textures[start : start + size].astype(np.float64)
                mean = texels.mean()
                changed = np.clip(mean + contrast * (texels - mean), 0, 255)
                self._model.tex_data[start : start + size] = np.rint(changed)
                mujoco.mjr_uploadTexture(self._model, self._context, texture)

    def _set_camera(self, pose: CameraPose, camera: Hello, values: dict[str, float]) -> None:
        angle, zoom = math.radians(values["camera_pitch"]), values["zoom"]
        cos, sin = math.cos(angle), math.sin(angle)
        pitched = pose.rotation @ np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]])
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, (pitched @ _TO_OPENGL).ravel())
        self._data.mocap_quat[0] = quaternion
        self._data.mocap_pos[0] = pose.position
        self._data.mocap_pos[0, 2] += values["camera_height"]
        self._model.cam_intrinsic[0] = (
            zoom * camera.fx, zoom * camera.fy,
            camera.width / 2 - camera.cx, camera.height / 2 - camera.cy,
        )  # fmt: skip


def _distorted(
    rgb: NDArray[np.uint8], depth: NDArray[np.float32], camera: Hello, values: dict[str, float]
) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """The images behind a lens with radial distortion; black and 0 where it sees farther."""
    if values["distortion"] == 0:
        return rgb, depth
    fx, fy = values["zoom"] * camera.fx, values["zoom"] * camera.fy
    matrix = np.array([[fx, 0, camera.cx - 0.5], [0, fy, camera.cy - 0.5], [0, 0, 1]])
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    coefficients = np.array([values["distortion"], 0.0, 0.0, 0.0])
    straight = cv2.undistortPoints(pixels, matrix, coefficients, P=matrix)
    x, y = (straight[:, 0, axis].reshape(rgb.shape[:2]).astype(np.float32) for axis in (0, 1))
    seen: Any = cv2.remap(np.ascontiguousarray(rgb), x, y, cv2.INTER_LINEAR)
    near: Any = cv2.remap(np.ascontiguousarray(depth), x, y, cv2.INTER_NEAREST)
    return seen, near


def main() -> None:
    rooms: dict[tuple[int, int], Room] = {}

    def render(
        pose: CameraPose, camera: Hello, values: dict[str, float]
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
        size = camera.width, camera.height
        if size not in rooms:
            rooms[size] = Room(*size)
        return rooms[size].render(pose, camera, values)

    serve(render, "MuJoCo room", VERSION, PARAMETERS)


if __name__ == "__main__":
    main()
