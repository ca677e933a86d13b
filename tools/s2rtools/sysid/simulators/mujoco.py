"""A differential-drive robot in MuJoCo, with wheels that roll by contact friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from s2rstore.errors import RequestError
from s2rstore.geometry.angles import wrap
from s2rtools.sysid.simulators.planar import COMMON
from s2rtools.sysid.simulators.simulator import (
    LATENCY,
    Floats,
    Integers,
    Replays,
    Simulator,
    Values,
)

STEP = 0.005
_SETTLING_STEPS = 200
"""Steps at rest before a replay, until contact forces balance the weight."""
_QUATERNION = slice(3, 7)


class MuJoCo(Simulator):
    """Simulator with the parameters of the planar one, without drag.

    The torque of a step is the mean of the delayed commands over the step, so the latency is
    resolved more finely than the step.
    """

    name = "mujoco"
    parameters = COMMON
    torques = ("left_torque", "right_torque")
    efforts = ("left_effort", "right_effort")
    shared = ("mass", "gain", "friction", "damping")
    evaluations = 120

    def __init__(self, step: float = STEP) -> None:
        try:
            import mujoco
            import mujoco.rollout
        except ModuleNotFoundError as error:
            raise RequestError(
                "the simulator mujoco needs MuJoCo; install it with `pip install 's2rtui[mujoco]'`"
            ) from error
        self.step = step
        self._mujoco = mujoco
        self._cached: tuple[str, Any, Any, Floats] | None = None

    def replay(self, values: Values, replays: Replays, states: Floats) -> Floats:
        model, data, rest = self._model(values)
        begin = replays.times[replays.first[:-1]]
        spans = replays.times[replays.first[1:] - 1] - begin
        count = max(1, int(np.ceil(spans.max() / self.step - 1e-9)))
        control = self._control(values[LATENCY], replays, begin, count)
        full = _full_states(values, rest, states)
        moved, _ = self._mujoco.rollout.rollout(model, data, full, control)
        path = np.concatenate([full[:, None], moved], axis=1)[:, :, 1:]
        return _sampled(_flat(path, states), replays, begin, self.step)

    def _model(self, values: Values) -> tuple[Any, Any, Floats]:
        """Model, data and the full state at rest; cached for the last values."""
        text = model_text(values, self.step)
        if self._cached is None or self._cached[0] != text:
            model = self._mujoco.MjModel.from_xml_string(text)
            data = self._mujoco.MjData(model)
            rest = np.concatenate([[0.0], data.qpos, data.qvel])[None]
            settled, _ = self._mujoco.rollout.rollout(model, data, rest, nstep=_SETTLING_STEPS)
            rest = settled[0, -1].copy()
            rest[1 + model.nq :] = 0.0
            self._cached = (text, model, data, rest)
        return self._cached[1:]

    def _control(self, latency: float, replays: Replays, begin: Floats, count: int) -> Floats:
        """The mean of the delayed commands over each step, (replays, count, 2)."""
        edges = self.step * np.arange(count + 1) - latency
        control = np.empty((len(replays), count, 2))
        for number, drive in enumerate(replays.drive):
            low, high = replays.held[drive], replays.held[drive + 1]
            time = replays.command_time[low:high]
            at = begin[number] + edges
            k = np.searchsorted(time, at, side="right") - 1
            inside = np.maximum(k, 0)
            for channel, values in enumerate(replays.values[:, low:high]):
                areas = np.concatenate([[0.0], np.cumsum(values[:-1] * np.diff(time))])
                integral = areas[inside] + values[inside] * (at - time[inside])
                control[number, :, channel] = np.diff(np.where(k < 0, 0.0, integral)) / self.step
        return control


def _full_states(values: Values, rest: Floats, states: Floats) -> Floats:
    """MuJoCo's states (time, qpos, qvel) of a robot that rolls without slip; `rest` is at rest."""
    full = np.tile(rest, (len(states), 1))
    x, y, heading, v, w = states.T
    full[:, 0] = 0.0
    full[:, 1], full[:, 2] = x, y
    turn = np.stack([np.cos(heading / 2), 0 * x, 0 * x, np.sin(heading / 2)], axis=1)
    full[:, 1:][:, _QUATERNION] = turn
    velocity = full[:, 10:]
    velocity[:, 0], velocity[:, 1] = v * np.cos(heading), v * np.sin(heading)
    velocity[:, 5] = w
    half, radius, unequal = values["track"] / 2, values["wheel_radius"], values["wheels"]
    velocity[:, 6] = (v - w * half) / (radius * (1 - unequal / 2))
    velocity[:, 7] = (v + w * half) / (radius * (1 + unequal / 2))
    return full


def _flat(path: Floats, states: Floats) -> Floats:
    """States (r, steps, 5), with unwrapped headings, from qpos and qvel."""
    w, i, j, k = np.moveaxis(path[:, :, _QUATERNION], -1, 0)
    yaw = np.arctan2(2 * (w * k + i * j), 1 - 2 * (j * j + k * k))
    turned = wrap(np.diff(yaw, axis=1))
    heading = states[:, 2, None] + np.concatenate(
        [np.zeros((len(path), 1)), np.cumsum(turned, axis=1)], axis=1
    )
    velocity = path[:, :, 9:]
    speed = velocity[:, :, 0] * np.cos(heading) + velocity[:, :, 1] * np.sin(heading)
    return np.stack([path[:, :, 0], path[:, :, 1], heading, speed, velocity[:, :, 5]], axis=2)


def _sampled(path: Floats, replays: Replays, begin: Floats, step: float) -> Floats:
    """States at the replays' times: cubic positions between steps, the others linear."""
    number: Integers = np.repeat(np.arange(len(replays)), np.diff(replays.first))
    place = (replays.times - begin[number]) / step
    k = np.clip(np.floor(place + 1e-9).astype(np.int64), 0, path.shape[1] - 2)
    s = (place - k)[:, None]
    a, b = path[number, k], path[number, k + 1]
    out = a + s * (b - a)
    for state, weight in ((a, step * (s**3 - 2 * s**2 + s)), (b, step * (s**3 - s**2))):
        slope = state[:, 3:4] * np.stack([np.cos(state[:, 2]), np.sin(state[:, 2])], axis=1)
        out[:, :2] += weight * slope
    out[:, :2] += (3 * s**2 - 2 * s**3 - s) * (b[:, :2] - a[:, :2])
    return out


_MODEL = """\
<mujoco model="differential-drive">
  <option timestep="{step!r}" integrator="implicitfast" cone="elliptic" impratio="20"/>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" condim="1" friction="0 0 0"/>
    <body name="robot" pos="0 0 {radius!r}">
      <freejoint/>
      <inertial pos="0 0 0" mass="{chassis!r}" diaginertia="{tilt!r} {tilt!r} {yaw!r}"/>
      <geom type="sphere" size="{caster!r}" pos="{reach!r} 0 {low!r}" condim="1" mass="0"/>
      <geom type="sphere" size="{caster!r}" pos="-{reach!r} 0 {low!r}" condim="1" mass="0"/>
{wheels}    </body>
  </worldbody>
  <actuator>
    <motor joint="left" gear="{gain!r}"/>
    <motor joint="right" gear="{gain!r}"/>
  </actuator>
</mujoco>
"""

_WHEEL = """\
      <body name="{name}" pos="0 {side!r} {drop!r}">
        <joint name="{name}" type="hinge" axis="0 1 0" damping="{damping!r}"
               frictionloss="{friction!r}" solimpfriction="0.999 0.9999 0.001"
               solreffriction="0.01 1"/>
        <inertial pos="0 0 0" mass="{mass!r}" diaginertia="{inertia!r} {inertia!r} {inertia!r}"/>
        <geom type="ellipsoid" size="{radius!r} {thin!r} {radius!r}" condim="3" mass="0"
              friction="1 0 0"/>
      </body>
"""

_WHEEL_SHARE = 0.005
"""Share of the robot's mass in each wheel; its inertia is negligible."""
_CLEARANCE = 0.002
"""Distance from the casters to the floor on a level robot, m."""


def model_text(values: Values, step: float) -> str:
    """MJCF for the values of the simulator's parameters; friction and damping act at the axles."""
    mass, half, radius = values["mass"], values["track"] / 2, values["wheel_radius"]
    wheel = _WHEEL_SHARE * mass
    yaw = values["gyration"] * mass * half * half - 2 * wheel * half * half
    caster = radius / 4
    radii = {
        "left": radius * (1 - values["wheels"] / 2),
        "right": radius * (1 + values["wheels"] / 2),
    }
    wheels = "".join(
        _WHEEL.format(
            name=name, side=half if name == "left" else -half, drop=size - radius,
            damping=values["damping"] / 2 * radius**2, friction=values["friction"] / 2 * radius,
            mass=wheel, inertia=wheel * size**2 / 4, radius=size, thin=size / 5,
        )
        for name, size in radii.items()
    )  # fmt: skip
    return _MODEL.format(
        step=step, radius=radius, chassis=mass - 2 * wheel, yaw=yaw, tilt=yaw * 0.6,
        caster=caster, reach=half * 0.8, low=caster - radius + _CLEARANCE,
        gain=values["gain"], wheels=wheels,
    )  # fmt: skip
