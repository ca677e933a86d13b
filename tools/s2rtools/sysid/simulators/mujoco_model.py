"""A differential-drive robot as MJCF: a box on two driven wheels and two frictionless casters."""

from __future__ import annotations

from s2rtools.sysid.simulators.simulator import Values

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
"""Of the robot's mass, in each wheel: so light that it adds no inertia worth naming."""
_CLEARANCE = 0.002
"""Metres from the casters to the floor while the robot stands level."""


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
